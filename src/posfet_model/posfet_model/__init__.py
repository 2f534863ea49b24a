"""POSFET tactile sensing: device physics, reconstruction of force, contacts. Needs NumPy and PyYAML, not ROS."""
