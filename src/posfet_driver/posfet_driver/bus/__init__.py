"""CAN frames from any adapter: slcan, SocketCAN, python-can. Knows no board and no protocol."""
