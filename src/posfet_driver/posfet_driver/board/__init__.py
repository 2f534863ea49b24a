"""Connection to one board: client, state, commands, faults and report."""
