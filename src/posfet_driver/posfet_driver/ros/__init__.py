"""Driver node, and everything else that needs ROS."""
