"""Trackers behind one small interface."""
