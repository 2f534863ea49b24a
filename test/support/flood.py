# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

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
