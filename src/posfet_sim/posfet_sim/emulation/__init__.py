"""The simulated board as a node on a CAN bus, in real time or offline, with faults of its link."""
