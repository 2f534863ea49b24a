"""Encoding and decoding of scans and messages. Imports of the buses only `bus.frame`; no thread, no clock."""
