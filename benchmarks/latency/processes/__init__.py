"""The processes of one measurement: board, stack, listener, each started by `benchmarks.latency.rig`."""
