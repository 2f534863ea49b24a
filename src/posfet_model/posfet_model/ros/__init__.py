"""The model node and everything else that needs ROS."""
