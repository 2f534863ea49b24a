"""The model node, message conversion and node start-up: the only subpackage that imports ROS."""
