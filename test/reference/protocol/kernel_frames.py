# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Frames as a SocketCAN socket hands them over, in Python."""

from __future__ import annotations

import struct

from posfet_driver.bus.frame import ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

_FRAME = struct.Struct("=IBB2x")
_FD_SIZE = 72
_RATE_SWITCH = 0x01
_SPECIAL = 0xE000_0000
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000


def parse_kernel_frame(data: bytes) -> Frame:
    """Return a frame from the bytes of the kernel."""
    identifier, length, flags = _FRAME.unpack_from(data)
    kind = 0
    if len(data) == _FD_SIZE:
        kind = FD | RATE_SWITCH if flags & _RATE_SWITCH else FD
    if identifier & _SPECIAL:
        kind |= (
            EXTENDED * bool(identifier & _EXTENDED)
            | REMOTE * bool(identifier & _REMOTE)
            | ERROR * bool(identifier & _ERROR)
        )
        identifier &= ~_SPECIAL
    return identifier, kind, data[_FRAME.size : _FRAME.size + length]
