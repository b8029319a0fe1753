"""Bring-up of a robot: look at everything, move by hand, calibrate."""
