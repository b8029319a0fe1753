"""What the controller believes about the robot: kinematics, reach, desired paths."""
