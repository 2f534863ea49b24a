"""The commands of `posfet can`. No ROS."""
