"""The simulated board, what touches it, and all that judges the stack with it."""
