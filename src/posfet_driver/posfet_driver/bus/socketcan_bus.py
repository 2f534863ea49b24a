# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""SocketCAN bus that reads many frames at once and reports errors that only the kernel knows."""

from __future__ import annotations

import errno
import fcntl
import select
import socket
import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import can
from can.interfaces.socketcan import constants

from posfet_core.protocol import parse_kernel_frame
from posfet_driver.bus import can_interface
from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, error_frame
from posfet_driver.bus.frame import ERROR, EXTENDED, BoardFrames, Frame
from posfet_driver.bus.message_conversion import message_of
from posfet_model._lib.units import NANOSECONDS

if TYPE_CHECKING:
    from can.interfaces.socketcan import SocketcanBus

READ_LIMIT: Final = 1024
"""Largest number of frames read at once."""
SEND_TIMEOUT: Final = 0.1
"""Longest time that a frame waits for room in the socket [s]."""
RECEIVE_BUFFER: Final = 4 << 20
"""Requested size of the socket's receive buffer [byte]; a frame takes nearly 1 kB of it. Without CAP_NET_ADMIN the
kernel limits it to twice net.core.rmem_max."""

_FD_SIZE: Final = 72
"""Length of struct canfd_frame, the longest that is read [byte]."""
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
_TIME: Final = struct.Struct("@ll")
"""struct timespec."""
_SO_RCVBUFFORCE: Final = 33
_SO_MEMINFO: Final = 55
_MEMINFO: Final = struct.Struct("=9I")
"""Result of SO_MEMINFO (linux/sock_diag.h); the last number counts the frames dropped for lack of room."""


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

    def __init__(self, bus: SocketcanBus, board: BoardFrames | None = None) -> None:
        self._bus = bus
        self._socket: socket.socket = bus.socket
        self._board = board
        self._board_only = True
        self.arrival_stamp = 0
        """Wall time at which the newest frame of the last read arrived [ns], by the kernel; 0: unknown."""
        self._waiting: list[Frame] = []
        self._dropped = 0
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER)
        except PermissionError:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        # python-can asks for a stamp with each frame; without that request the kernel keeps the newest one.
        self._socket.setsockopt(socket.SOL_SOCKET, constants.SO_TIMESTAMPNS, 0)
        self._newest_stamp()
        self._receive_others()

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
        self.arrival_stamp = 0
        if not self._poll.poll(0 if frames else timeout * 1000):
            return frames
        receive = self._socket.recv
        try:
            while len(frames) < READ_LIMIT:
                frames.append(parse_kernel_frame(receive(_FD_SIZE, socket.MSG_DONTWAIT)))
        except BlockingIOError:
            pass
        except OSError as error:
            raise can.CanOperationError(f"cannot read: {error.strerror}", error.errno) from error
        self.arrival_stamp = self._newest_stamp()
        dropped = _MEMINFO.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))[-1]
        if dropped != self._dropped:
            self._dropped = dropped
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

    def _newest_stamp(self) -> int:
        try:
            seconds, nanoseconds = _TIME.unpack(fcntl.ioctl(self._socket, _GET_STAMP, bytes(_TIME.size)))
        except OSError:  # no frame was read yet
            return 0
        return int(seconds) * NANOSECONDS + int(nanoseconds)

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
