"""Bytes to scans and back. Imports no bus but `bus.frame`, no thread, no clock."""
