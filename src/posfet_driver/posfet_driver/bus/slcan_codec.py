# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

r"""Lines of the slcan protocol: CAN frames in hexadecimal ASCII, as in LAWICEL's CAN232 manual and CANable's firmware.

A line is a letter, the identifier (3 or 8 digits), the length code, and the data; it ends with \r. Letters: t T: data
frame with an 11-bit or 29-bit identifier; r R: remote frame; d D: CAN FD; b B: CAN FD with rate switch. Lines are
written here and read by the compiled `LineReader` and `parse_line`.
"""

from __future__ import annotations

from typing import Final

from posfet_core.protocol import LineReader, parse_line
from posfet_driver.bus.frame import EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

__all__ = ["LineReader", "encode_line", "parse_line"]

END: Final = b"\r"
REFUSED: Final = b"\a"
"""Reply of an adapter that rejects a line; ends a line like END."""

FLAG_OVERFLOW: Final = 0x09
FLAG_WARNING: Final = 0x04
FLAG_PASSIVE: Final = 0x20
FLAG_BUS_ERROR: Final = 0x80
"""Bits of the reply to the command F: receive queue full or data overrun, error warning, error passive, bus error."""

FD_LENGTHS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Data length [byte] of each length code of CAN FD."""

_LETTERS: Final = {0: "t", REMOTE: "r", FD: "d", FD | RATE_SWITCH: "b"}
_CODES: Final = {length: f"{code:X}" for code, length in enumerate(FD_LENGTHS)}


def encode_line(frame: Frame) -> bytes:
    """Return the line of a frame, with its end. Raises ValueError when slcan cannot carry the frame."""
    identifier, kind, data = frame
    letter = _LETTERS.get(kind & ~EXTENDED)
    code = _CODES.get(len(data))
    if letter is None or code is None or (not kind & FD and len(data) > 8):
        raise ValueError(f"slcan has no line for a frame of kind {kind} with {len(data)} bytes")
    name = f"{letter.upper()}{identifier:08X}" if kind & EXTENDED else f"{letter}{identifier:03X}"
    digits = "" if kind & REMOTE else data.hex().upper()
    return f"{name}{code}{digits}\r".encode()
