"""The simulated board: charge, read-out, noise, sensor errors, ground truth. Takes its loads from outside."""
