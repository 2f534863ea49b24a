"""SocketCAN bus that reads many frames at once and reports errors that only the kernel knows."""

from __future__ import annotations

import errno
import select
import socket
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Final

import can

from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, error_frame
from posfet_driver.bus.frame import ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.message_conversion import message_of

if TYPE_CHECKING:
    from can.interfaces.socketcan import SocketcanBus

NETWORK_DEVICES: Final = Path("/sys/class/net")
READ_LIMIT: Final = 1024
"""Largest number of frames read at once."""
SEND_TIMEOUT: Final = 0.1
"""Longest time that a frame waits for room in the socket [s]."""
RECEIVE_BUFFER: Final = 4 << 20
"""Requested size of the socket's receive buffer [byte]; a frame takes nearly 1 kB of it. Without CAP_NET_ADMIN the
kernel limits it to twice net.core.rmem_max."""

_FRAME: Final = struct.Struct("=IBB2x")
"""Head of struct can_frame and canfd_frame (linux/can.h): identifier with flags, length, flags of CAN FD."""
_FD_SIZE: Final = 72
_RATE_SWITCH: Final = 0x01
_SPECIAL: Final = 0xE000_0000
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
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

    Parameters
    ----------
    bus : can.interfaces.socketcan.SocketcanBus
        The open bus.
    """

    malformed_lines = 0

    def __init__(self, bus: SocketcanBus) -> None:
        self._bus = bus
        self._socket: socket.socket = bus.socket
        self._device = NETWORK_DEVICES / bus.channel if bus.channel else None
        self._waiting: list[Frame] = []
        self._dropped = 0
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER)
        except PermissionError:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)

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
        if not self._poll.poll(0 if frames else timeout * 1000):
            return frames
        receive = self._socket.recv
        try:
            while len(frames) < READ_LIMIT:
                frames.append(_frame(receive(_FD_SIZE, socket.MSG_DONTWAIT)))
        except BlockingIOError:
            pass
        except OSError as error:
            raise can.CanOperationError(f"cannot read: {error.strerror}", error.errno) from error
        dropped = _MEMINFO.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))[-1]
        if dropped != self._dropped:
            self._dropped = dropped
            frames.append(error_frame(CONTROLLER, OVERFLOW))
        return frames

    def write_frame(self, frame: Frame) -> None:
        """Send one frame. Raises can.CanOperationError when the network device is down or has been removed."""
        try:
            self._bus.send(message_of(frame), timeout=SEND_TIMEOUT)
        except can.CanOperationError as error:
            if error.error_code not in {errno.ENOBUFS, None}:  # None: python-can found no room in the socket itself
                raise
            self._waiting.append(error_frame(NO_ACKNOWLEDGE))

    def ask_state(self) -> None:
        """Queue an error frame when the controller is bus-off (no carrier): the kernel reports that only once."""
        if self._device and _content(self._device / "carrier") == "0":
            self._waiting.append(error_frame(BUS_OFF))

    def shutdown(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


def presence(channel: str) -> object:
    """Return a value that changes when the network device is added, removed or switched."""
    return tuple(_content(NETWORK_DEVICES / channel / name) for name in ("ifindex", "flags", "operstate"))


def _frame(data: bytes) -> Frame:
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


def _content(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return ""
