"""The controller's model of the robot: kinematics, workspace, desired paths."""
