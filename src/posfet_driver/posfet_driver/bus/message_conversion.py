# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Conversion between frames and python-can's messages."""

from __future__ import annotations

from typing import Final

import can

from posfet_driver.bus.frame import ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

_HIGHEST: Final = {False: 0x7FF, True: 0x1FFF_FFFF}
_CLASSIC_LENGTH: Final = 8
_FD_LENGTH: Final = 64
_BYTES: Final = (bytes, bytearray)


def frame_of(message: can.Message) -> Frame:
    """Return a python-can message as a frame.

    Parameters
    ----------
    message : can.Message
        Any message: backends do not check what they deliver.

    Returns
    -------
    Frame
        The frame.

    Raises
    ------
    ValueError
        When no CAN frame has these values; one line.
    """
    identifier, error = message.arbitration_id, bool(message.is_error_frame)
    fd, remote, extended = bool(message.is_fd), bool(message.is_remote_frame), bool(message.is_extended_id)
    kind = EXTENDED * extended | REMOTE * remote | ERROR * error | FD * fd | RATE_SWITCH * bool(message.bitrate_switch)
    # Error frames hold error classes in the bits of an identifier.
    if not isinstance(identifier, int) or not 0 <= identifier <= _HIGHEST[extended or error]:
        raise ValueError(f"a frame cannot have the identifier {identifier!r}")
    limit = _FD_LENGTH if fd else _CLASSIC_LENGTH
    length = message.dlc if remote else len(message.data) if isinstance(message.data, _BYTES) else None
    if not isinstance(length, int) or not 0 <= length <= limit:
        raise ValueError(f"a frame cannot have the length {length!r}")
    return identifier, kind, bytes(length) if remote else bytes(message.data)


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
