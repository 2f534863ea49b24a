"""The driver node and everything else that needs ROS."""
