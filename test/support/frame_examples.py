"""One frame of every kind that a bus can carry."""

from __future__ import annotations

from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

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
