"""Latency, sustained rates and start-up time of the running stack, in several processes."""
