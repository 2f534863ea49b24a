"""POSFET readout boards: CAN protocol, drivers and the simulated board. Needs python-can and NumPy, not ROS."""
