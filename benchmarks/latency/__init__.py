"""Latency, rates and start of the running stack, in several processes."""
