"""What error frames say, in the layout of SocketCAN (linux/can/error.h), which other adapters are brought to.

The identifier has one bit for each class of error; byte 1 of the data tells more of the controller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from posfet_driver.bus.frame import ERROR, Frame

CONTROLLER: Final = 0x004
PROTOCOL: Final = 0x008
NO_ACKNOWLEDGE: Final = 0x020
BUS_OFF: Final = 0x040
BUS_ERROR: Final = 0x080
"""Classes of errors: bits of the identifier."""

OVERFLOW: Final = 0x01 | 0x02
WARNING: Final = 0x04 | 0x08
PASSIVE: Final = 0x10 | 0x20
"""Bits of byte 1, for receiving and sending, when the class is CONTROLLER."""

_LENGTH = 8


@dataclass(slots=True)
class ErrorCounts:
    """Error frames by cause; one frame may have several. Never falls."""

    frames: int = 0
    """Error frames, whatever they say."""
    bus_off: int = 0
    """The controller has taken itself off the bus."""
    passive: int = 0
    """The controller has seen so many errors that it no longer objects to any."""
    unreadable: int = 0
    """Bits or forms on the bus that are no CAN at this bitrate."""
    unacknowledged: int = 0
    """A frame was sent and nobody received it."""
    overflow: int = 0
    """The adapter had no room for a frame."""

    def take(self, identifier: int, data: bytes) -> None:
        """Count one error frame."""
        self.frames += 1
        controller = data[1] if identifier & CONTROLLER and len(data) > 1 else 0
        self.bus_off += bool(identifier & BUS_OFF)
        self.passive += bool(controller & PASSIVE)
        self.unreadable += bool(identifier & (PROTOCOL | BUS_ERROR))
        self.unacknowledged += bool(identifier & NO_ACKNOWLEDGE)
        self.overflow += bool(controller & OVERFLOW)


def error_frame(classes: int, controller: int = 0) -> Frame:
    """Return the error frame of some classes and, with CONTROLLER among them, the controller's bits."""
    return classes, ERROR, bytes([0, controller]).ljust(_LENGTH, b"\0")
