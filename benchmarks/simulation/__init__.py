"""Cost and accuracy of the simulated board and the follower models."""
