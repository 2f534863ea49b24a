"""The simulated board: from loads on the taxels to scans, with a sensor error model. Knows no scene."""
