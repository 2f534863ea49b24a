# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One frame of every kind that a bus can carry."""

from __future__ import annotations

import struct

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

FRAMES: list[Frame] = [
    (0x123, CLASSIC, b"\x01\x02"),
    (0x000, CLASSIC, b""),
    (0x1234_5678, EXTENDED, bytes(range(8))),
    (0x7FF, REMOTE, bytes(5)),
    (0x1FFF_FFFF, EXTENDED | REMOTE, bytes(8)),
    (0x103, FD, bytes(range(48))),
    (0x103, FD | RATE_SWITCH, bytes(range(64))),
    (0x1ABC_DEF0, FD | EXTENDED, bytes(12)),
    (0x1ABC_DEF0, FD | RATE_SWITCH | EXTENDED, bytes(64)),
]


def to_kernel(frame: Frame) -> bytes:
    """Return a frame as a read of a socket returns it."""
    identifier, kind, data = frame
    flags = 0x8000_0000 * bool(kind & EXTENDED) | 0x4000_0000 * bool(kind & REMOTE) | 0x2000_0000 * bool(kind & ERROR)
    size = 64 if kind & FD else 8
    return struct.pack("=IBB2x", identifier | flags, len(data), kind & RATE_SWITCH != 0) + data[:size].ljust(
        size, b"\0"
    )
