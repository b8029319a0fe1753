"""The simulated robot, its servos and its camera."""
