# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""SocketCAN bus that reads many frames at once and reports errors that only the kernel knows."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import can
from can.interfaces.socketcan import constants

from posfet_core.protocol import SocketPort
from posfet_driver.bus import can_interface
from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, error_frame
from posfet_driver.bus.frame import ERROR, EXTENDED, BoardFrames, Frame
from posfet_driver.bus.message_conversion import message_of

if TYPE_CHECKING:
    from can.interfaces.socketcan import SocketcanBus

SEND_TIMEOUT: Final = 0.1
"""Longest time that a frame waits for room in the socket [s]."""
RECEIVE_BUFFER: Final = 4 << 20
"""Requested size of the socket's receive buffer [byte]; a frame takes nearly 1 kB of it. Without CAP_NET_ADMIN the
kernel limits it to twice net.core.rmem_max."""

_OTHER: Final = EXTENDED | ERROR
"""Kinds of frames that no board sends."""
_EXTENDED, _REMOTE = 0x8000_0000, 0x4000_0000
_FILTER: Final = struct.Struct("=II")
"""struct can_filter: identifier and mask, both with flags."""
_INVERTED: Final = 0x2000_0000
"""Flag of a filter's identifier: what does not match is received (CAN_INV_FILTER)."""
_STANDARD: Final = 0x7FF
_GET_STAMP: Final = 0x8907
"""Request for the time stamp of the frame that was read last (SIOCGSTAMPNS)."""
_SO_RCVBUFFORCE: Final = 33


class SocketcanFrameBus:
    """Adapts python-can's SocketcanBus to FrameBus: reads its socket directly, without a can.Message per frame.

    Frames that the kernel dropped because they were not read in time, and a bus-off controller, are reported as the
    error frames that other adapters send. A command that finds the send queue full is dropped and reported as
    unacknowledged: while the cable is unplugged nothing leaves that queue, and it outlives the socket, so that
    reopening the bus would not help.

    With `board`, the kernel hands over that board's frames alone from its first one on, and those of other nodes only
    while it is silent (from `ask_state` on), when they tell what is wrong. Frames sent to the board are never received:
    those that an earlier socket left in the send queue, and that leave it when the cable is plugged in, look like those
    of another node. Error frames are always received.

    Parameters
    ----------
    bus : can.interfaces.socketcan.SocketcanBus
        The open bus.
    board : BoardFrames, optional
        The board that the bus is read for; by default every frame is received.
    """

    unreadable = 0
    must_be_asked = False

    def __init__(self, bus: SocketcanBus, board: BoardFrames | None = None) -> None:
        self._bus = bus
        self._socket: socket.socket = bus.socket
        self._board = board
        self._board_only = True
        self._waiting: list[Frame] = []
        self._dropped = 0
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER)
        except PermissionError:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        # python-can asks for a stamp with each frame; without that request the kernel keeps the newest one.
        self._socket.setsockopt(socket.SOL_SOCKET, constants.SO_TIMESTAMPNS, 0)
        self._start_stamps()
        self._port = SocketPort(self._socket.fileno())
        self._receive_others()

    @property
    def arrival_stamp(self) -> int:
        """Wall time at which the newest frame of the last read arrived [ns], by the kernel; 0: unknown."""
        return self._port.stamp

    @property
    def port(self) -> SocketPort:
        """Compiled port of the bus."""
        return self._port

    @property
    def read_by_port(self) -> bool:
        """Whether all frames can be read from the port now: no error frame waits here, and no filter is to be set."""
        return self._board_only and not self._waiting

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are waiting; when there is none, wait for the first.

        Parameters
        ----------
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        list of Frame
            Frames and error frames; empty after the timeout.

        Raises
        ------
        can.CanOperationError
            When the network device is down or has been removed.
        """
        frames, self._waiting = self._waiting, []
        try:
            frames += self._port.read(0.0 if frames else timeout)
        except EOFError:
            self._raise_pending_error()
        except OSError as error:
            raise can.CanOperationError(f"cannot read: {error.strerror}", error.errno) from error
        if self._port.dropped != self._dropped:
            self._dropped = self._port.dropped
            frames.append(error_frame(CONTROLLER, OVERFLOW))
        if not self._board_only:
            self._receive_board_only(frames)
        return frames

    def write_frame(self, frame: Frame) -> bool:
        """Send one frame; return whether there was room for it.

        Parameters
        ----------
        frame : Frame
            Frame to send.

        Returns
        -------
        bool
            False when the send queue is full: then the frame is dropped, and reported as unacknowledged.

        Raises
        ------
        can.CanOperationError
            When the network device is down or has been removed.
        """
        try:
            self._bus.send(message_of(frame), timeout=SEND_TIMEOUT)
        except can.CanOperationError as error:
            if error.error_code not in {errno.ENOBUFS, None}:  # None: python-can found no room in the socket itself
                raise
            self._waiting.append(error_frame(NO_ACKNOWLEDGE))
            return False
        return True

    def ask_state(self) -> None:
        """Queue an error frame when the controller is bus-off: the kernel reports that only once.

        Asked for a board that is silent: from now on the frames of other nodes are received, too.
        """
        if can_interface.is_bus_off(self._bus.channel):
            self._waiting.append(error_frame(BUS_OFF))
        self._receive_others()

    def shutdown(self) -> None:
        """Close the bus."""
        self._bus.shutdown()

    def _start_stamps(self) -> None:
        """Have the kernel stamp the frames; it does from the first request on."""
        with contextlib.suppress(OSError):  # no frame was read yet
            fcntl.ioctl(self._socket, _GET_STAMP, bytes(2 * struct.calcsize("l")))

    def _raise_pending_error(self) -> None:
        """Raise the error for which the socket has woken its reader without a frame."""
        code = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            raise can.CanOperationError(f"cannot read: {os.strerror(code)}", code)

    def _receive_others(self) -> None:
        if self._board and self._board_only:
            self._board_only = False
            self._set_filters([(self._board.sent | _INVERTED, _STANDARD | _EXTENDED | _REMOTE)])

    def _receive_board_only(self, frames: list[Frame]) -> None:
        """Narrow the filter when the board is among the senders of `frames`."""
        board = self._board
        if board and any(identifier in board.received for identifier, kind, _ in frames if not kind & _OTHER):
            self._board_only = True
            self._set_filters(list(_range_filters(board.received)))

    def _set_filters(self, filters: list[tuple[int, int]]) -> None:
        packed = b"".join(_FILTER.pack(identifier, mask) for identifier, mask in filters)
        try:
            self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, packed)
        except OSError as error:
            raise can.CanOperationError(f"cannot filter: {error.strerror}", error.errno) from error


def _range_filters(identifiers: range) -> Iterator[tuple[int, int]]:
    """Yield filters that together accept a range of 11-bit identifiers: blocks of a power of two, each aligned."""
    first = identifiers.start
    while first < identifiers.stop:
        size = first & -first or _STANDARD + 1
        while size > identifiers.stop - first:
            size >>= 1
        yield first, (_STANDARD & ~(size - 1)) | _EXTENDED
        first += size
