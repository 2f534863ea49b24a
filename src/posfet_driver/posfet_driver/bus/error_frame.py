# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Error frames in the layout of SocketCAN (linux/can/error.h), to which other adapters are converted.

The identifier has one bit for each error class; byte 1 of the data holds the state of the controller.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from posfet_driver.bus.frame import ERROR, Frame

CONTROLLER: Final = 0x004
PROTOCOL: Final = 0x008
NO_ACKNOWLEDGE: Final = 0x020
BUS_OFF: Final = 0x040
BUS_ERROR: Final = 0x080
"""Error classes: bits of the identifier."""

OVERFLOW: Final = 0x01 | 0x02
WARNING: Final = 0x04 | 0x08
PASSIVE: Final = 0x10 | 0x20
"""Bits of byte 1, for receiving and sending, when the class is CONTROLLER."""

_LENGTH = 8


@dataclass(slots=True)
class ErrorCounts:
    """Error frames by cause; one frame may have several. Counters never fall."""

    frames: int = 0
    """Error frames of any cause."""
    bus_off: int = 0
    """The controller went bus-off."""
    passive: int = 0
    """The controller is error-passive: after many errors it no longer signals any."""
    bit_errors: int = 0
    """Bits or frame formats on the bus that are no CAN at this bit rate."""
    unacknowledged: int = 0
    """A frame was sent and no node acknowledged it."""
    overflow: int = 0
    """The adapter had no room for a frame."""

    def count(self, frames: Iterable[Frame]) -> None:
        """Count the error frames among `frames`."""
        for identifier, kind, data in frames:
            if kind & ERROR:
                self._count(identifier, data)

    def _count(self, identifier: int, data: bytes) -> None:
        self.frames += 1
        controller = data[1] if identifier & CONTROLLER and len(data) > 1 else 0
        self.bus_off += bool(identifier & BUS_OFF)
        self.passive += bool(controller & PASSIVE)
        self.bit_errors += bool(identifier & (PROTOCOL | BUS_ERROR))
        self.unacknowledged += bool(identifier & NO_ACKNOWLEDGE)
        self.overflow += bool(controller & OVERFLOW)


def error_frame(classes: int, controller: int = 0) -> Frame:
    """Return an error frame.

    Parameters
    ----------
    classes : int
        Sum of error classes.
    controller : int, default 0
        State of the controller, when CONTROLLER is among the classes.

    Returns
    -------
    Frame
        The error frame, with 8 bytes of data.
    """
    return classes, ERROR, bytes([0, controller]).ljust(_LENGTH, b"\0")
