"""CAN frames as plain tuples, which cost a tenth of a can.Message, and their way to and from python-can."""

from __future__ import annotations

from typing import Final, Protocol, TypeAlias

import can

Frame: TypeAlias = tuple[int, int, bytes]
"""Identifier, kind (sum of the constants below), data; a remote frame carries as many zero bytes as it asks for."""

CLASSIC: Final = 0
"""Kind of a data frame with an 11-bit identifier and up to 8 bytes."""
EXTENDED: Final = 1
"""The identifier has 29 bits."""
REMOTE: Final = 2
"""The frame asks for data instead of carrying it."""
ERROR: Final = 4
"""The frame reports an error on the bus."""
FD: Final = 8
"""CAN FD: up to 64 bytes."""
RATE_SWITCH: Final = 16
"""CAN FD with the data phase at its own bitrate."""


class FrameBus(Protocol):
    """A bus that reads many frames at once. Every method raises can.CanError when the bus is gone."""

    @property
    def malformed_lines(self) -> int:
        """Lines of a serial adapter that were no frame and no reply; 0 where there are no lines."""
        ...

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are there; when none is, wait up to `timeout` [s] for the first."""
        ...

    def write_frame(self, frame: Frame) -> None:
        """Send one frame."""
        ...

    def ask_state(self) -> None:
        """Ask the adapter for errors on the bus; what it tells is read as error frames, if it tells anything."""
        ...

    def shutdown(self) -> None:
        """Close the bus."""
        ...


def frame_of(message: can.Message) -> Frame:
    """Return a python-can message as a frame."""
    kind = (
        EXTENDED * message.is_extended_id
        | REMOTE * message.is_remote_frame
        | ERROR * message.is_error_frame
        | FD * message.is_fd
        | RATE_SWITCH * message.bitrate_switch
    )
    data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
    return message.arbitration_id, kind, data


def message_of(frame: Frame, timestamp: float = 0.0) -> can.Message:
    """Return a frame as a python-can message; `timestamp` [s] since the epoch."""
    identifier, kind, data = frame
    remote = bool(kind & REMOTE)
    return can.Message(
        timestamp=timestamp,
        arbitration_id=identifier,
        is_extended_id=bool(kind & EXTENDED),
        is_remote_frame=remote,
        is_error_frame=bool(kind & ERROR),
        is_fd=bool(kind & FD),
        bitrate_switch=bool(kind & RATE_SWITCH),
        dlc=len(data),
        data=None if remote else data,
    )
