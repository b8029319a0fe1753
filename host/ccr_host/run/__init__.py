"""A run: clock, control loop, recording, metrics and report."""
