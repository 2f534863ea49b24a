"""The node of the simulated board."""
