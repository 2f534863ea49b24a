"""ROS node of the simulated board."""
