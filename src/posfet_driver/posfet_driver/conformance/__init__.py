"""Judges boards by the description of the protocol alone: posfet.dbc and posfet.yaml, not the driver's decoder."""
