"""Trackers with a common small interface."""
