"""SocketCAN as a bus that reads many frames at once, and that tells what only the kernel knows."""

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
"""Most frames taken at once."""
SEND_TIMEOUT: Final = 0.1
"""How long a frame may wait for room in the socket [s]."""
ROOM: Final = 4 << 20
"""Wanted size of the socket's receive buffer [byte]; a frame takes near 1 kB of it. Without the right to more
(CAP_NET_ADMIN) the kernel gives twice net.core.rmem_max at most."""

_FRAME: Final = struct.Struct("=IBB2x")
"""Head of struct can_frame and canfd_frame (linux/can.h): identifier with flags, length, flags of CAN FD."""
_FD_SIZE: Final = 72
_RATE_SWITCH: Final = 0x01
_SPECIAL: Final = 0xE000_0000
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_SO_RCVBUFFORCE: Final = 33
_SO_MEMINFO: Final = 55
_MEMINFO: Final = struct.Struct("=9I")
"""What SO_MEMINFO tells (linux/sock_diag.h); the last number is that of frames dropped for want of room."""


class SocketcanFrames:
    """A python-can SocketcanBus as a FrameBus: frames come from its socket, without a can.Message each.

    Frames that the kernel dropped because nobody read them in time, and a controller that is off the bus, are told as
    the error frames that other adapters send. A command that finds the send queue full is dropped and told as not
    acknowledged: while the cable is out nothing leaves that queue, and it outlives the socket, so that opening the bus
    anew would not help.
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
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, ROOM)
        except PermissionError:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM)

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are there; when none is, wait up to `timeout` [s] for the first.

        Raises can.CanOperationError when the device is gone or down.
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
        """Send one frame. Raises can.CanOperationError when the device is gone or down."""
        try:
            self._bus.send(message_of(frame), timeout=SEND_TIMEOUT)
        except can.CanOperationError as error:
            if error.error_code not in {errno.ENOBUFS, None}:  # None: python-can found no room in the socket itself
                raise
            self._waiting.append(error_frame(NO_ACKNOWLEDGE))

    def ask_state(self) -> None:
        """See whether the controller is off the bus: the kernel then takes the carrier away, and tells it only once."""
        if self._device and _content(self._device / "carrier") == "0":
            self._waiting.append(error_frame(BUS_OFF))

    def shutdown(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


def presence(channel: str) -> object:
    """Return something that differs when the network device came, went, or was switched."""
    return tuple(_content(NETWORK_DEVICES / channel / name) for name in ("ifindex", "flags", "operstate"))


def _frame(data: bytes) -> Frame:
    """Return what the kernel hands over as one frame."""
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
