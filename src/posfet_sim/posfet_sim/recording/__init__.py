"""Recordings of the simulated board: MCAP and CSV."""
