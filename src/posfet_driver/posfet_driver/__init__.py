"""Driver of POSFET readout boards: CAN buses, protocol, connection. Needs python-can and NumPy; ROS only in `ros`."""
