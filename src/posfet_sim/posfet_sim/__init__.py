"""Simulated POSFET readout board: contact mechanics, scenes, bus emulation, recordings and scores."""
