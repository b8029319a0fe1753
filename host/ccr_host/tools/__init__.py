"""Tools for the bring-up of a robot: checks, jogging, calibration; and the sweep."""
