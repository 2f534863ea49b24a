"""Sends frames of another node on a CAN interface until its input ends: python flood.py INTERFACE."""

from __future__ import annotations

import select
import socket
import struct
import sys

IDENTIFIER = 0x300
FRAMES = [struct.pack("=IB3x8s", IDENTIFIER + number, 8, bytes(8)) for number in range(16)]


def main(interface: str) -> None:
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sender:
        sender.bind((interface,))
        while not select.select([sys.stdin], [], [], 0.005)[0]:
            for frame in FRAMES:
                sender.send(frame)
        sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1])
