"""Conversion between frames and python-can's messages."""

from __future__ import annotations

import can

from posfet_driver.bus.frame import ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame


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
    """Return a frame as a python-can message; `timestamp` in [s] since the Unix epoch.

    Parameters
    ----------
    frame : Frame
        Frame of the driver.
    timestamp : float, optional
        Time of arrival [s] since the Unix epoch.
    """
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
