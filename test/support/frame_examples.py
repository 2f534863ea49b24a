# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One frame of every kind that a bus can carry, and the bytes of frames."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterable

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.slcan_codec import encode_line

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

JUNK = (b"z\r", b"\r", b"\a", b"F04\r", b"t1", b"t100G\r", b"t1008" + b"0" * 200 + b"\r", b"r1000\r")
"""Lines of an slcan adapter that are no frames."""


class LineStream:
    """The bytes of a slcan adapter, in any pieces, with lines that are no frames."""

    def __init__(self, noise: random.Random) -> None:
        self._noise = noise
        self._rest = b""

    def piece(self, frames: Iterable[Frame]) -> bytes:
        """Return what is read after some frames: it may end before the last ones, which the next piece begins with."""
        noise, stream = self._noise, bytearray(self._rest)
        for frame in frames:
            try:
                stream += encode_line(frame)
            except ValueError:  # slcan cannot carry it
                stream += b"x\r"
            if noise.random() < 0.01:
                stream += noise.choice(JUNK)
        cut = len(stream) - (noise.randrange(min(len(stream), 200) + 1) if noise.random() < 0.2 else 0)
        data, self._rest = bytes(stream[:cut]), bytes(stream[cut:])
        return data


def to_kernel(frame: Frame) -> bytes:
    """Return a frame as a read of a socket returns it."""
    identifier, kind, data = frame
    flags = 0x8000_0000 * bool(kind & EXTENDED) | 0x4000_0000 * bool(kind & REMOTE) | 0x2000_0000 * bool(kind & ERROR)
    size = 64 if kind & FD else 8
    return struct.pack("=IBB2x", identifier | flags, len(data), kind & RATE_SWITCH != 0) + data[:size].ljust(
        size, b"\0"
    )
