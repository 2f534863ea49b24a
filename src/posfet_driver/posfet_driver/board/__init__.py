"""The connection to one board: its client, state, commands, faults and report."""
