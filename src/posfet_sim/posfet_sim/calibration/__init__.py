"""The simulated calibration rig, and recordings of a real one."""
