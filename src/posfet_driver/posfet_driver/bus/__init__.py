"""Frames of any CAN adapter: slcan, SocketCAN, python-can. Knows no board and no protocol."""
