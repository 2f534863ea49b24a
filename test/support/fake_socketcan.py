# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""SocketCAN for kernels without it: python-can's own SocketcanBus on datagrams in the format of its frames.

Buffers, timestamps and the count of dropped frames are those of UDP on loopback. Filters, error frames, the send queue,
and an interface that goes down are emulated here as the kernel does it: `make test-vm` compares with a real one.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
import threading
from collections import deque
from pathlib import Path
from typing import Any

import pytest
from can.interfaces.socketcan import constants
from can.interfaces.socketcan import socketcan as upstream

from posfet_driver.bus import can_interface

QUEUE_LENGTH = 11
"""Frames that a CAN device holds: the 10 of its send queue, and one that has left it."""
INVERTED, ERROR = 0x2000_0000, 0x2000_0000
"""Flag of an inverted filter, and of an error frame."""
_FILTER = struct.Struct("=II")


def os_error(code: int) -> OSError:
    return OSError(code, os.strerror(code))


class Device:
    """A network device: every socket on it receives the frames that the others send."""

    def __init__(self, folder: Path, fd: bool) -> None:
        self.sockets: list[DeviceSocket] = []
        self.lock = threading.RLock()  # no socket is closed while another thread sends to it
        self.up = True
        self.queue_length = QUEUE_LENGTH
        self._stalled = False
        self._queue: deque[tuple[bytes, DeviceSocket]] = deque()
        self._folder = folder
        (folder / "device").mkdir(parents=True)
        for name, content in {"type": "280", "ifindex": "7", "mtu": "72" if fd else "16"}.items():
            self._write(name, content)
        self.switch(True)

    def carrier(self, on: bool) -> None:
        """Set the controller on or off the bus."""
        self._write("carrier", str(int(on)))
        self._write("operstate", "up" if on else "down")

    def switch(self, up: bool) -> None:
        """Set the device up or down; the sockets stay bound and fail once."""
        with self.lock:
            self.up = up
            self._queue.clear()
            for one in self.sockets if not up else ():
                one.fail(errno.ENETDOWN)
        self._write("flags", "0x40081" if up else "0x40080")
        self.carrier(up)

    def stall(self, on: bool) -> None:
        """Stop the send queue, as without an acknowledging node, or let out what is in it."""
        with self.lock:
            self._stalled = on
            while self._queue and not on:
                self.deliver(*self._queue.popleft())

    def send(self, data: bytes, sender: DeviceSocket) -> None:
        """Send a frame of one socket to all others."""
        with self.lock:
            if not self.up:
                raise os_error(errno.ENETDOWN)
            if not self._stalled:
                self.deliver(data, sender)
            elif len(self._queue) < self.queue_length:
                self._queue.append((data, sender))
            else:
                raise os_error(errno.ENOBUFS)

    def deliver(self, data: bytes, sender: DeviceSocket | None = None) -> None:
        """Deliver a frame, in the format of the kernel, to the sockets."""
        with self.lock:
            for other in self.sockets:
                if other is not sender and other.accepts(data):
                    other.sendto(data, other.getsockname())

    def _write(self, name: str, content: str) -> None:
        (self._folder / name).write_text(f"{content}\n", encoding="ascii")


class DeviceSocket(socket.socket):
    """A CAN socket emulated by a UDP socket."""

    devices: dict[str, Device]
    opened: list[DeviceSocket]
    device: Device | None = None

    def __init__(self) -> None:
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        super().bind(("127.0.0.1", 0))
        self.filters = [(0, 0)]
        self._error = 0
        self.opened.append(self)

    def setsockopt(self, level: int, option: int, value: Any) -> None:  # type: ignore[override]
        if level != constants.SOL_CAN_RAW:
            super().setsockopt(level, option, value)
        elif option == constants.CAN_RAW_FILTER:
            self.filters = list(_FILTER.iter_unpack(value))

    def accepts(self, data: bytes) -> bool:
        identifier = int.from_bytes(data[:4], "little")
        matches = (((identifier ^ wanted) & mask & ~INVERTED, wanted & INVERTED) for wanted, mask in self.filters)
        return bool(identifier & ERROR) or any(bool(differs) == bool(inverted) for differs, inverted in matches)

    def bind(self, address: tuple[str]) -> None:  # type: ignore[override]
        if address[0] not in self.devices:
            raise os_error(errno.ENODEV)
        self.device = self.devices[address[0]]
        with self.device.lock:
            self.device.sockets.append(self)
            if not self.device.up:
                self.fail(errno.ENETDOWN)

    def fail(self, code: int) -> None:
        """Make the next call fail; an empty datagram wakes a reader."""
        self._error = code
        self.sendto(b"", self.getsockname())

    def recv(self, size: int, flags: int = 0) -> bytes:  # type: ignore[override]
        data = b""
        while not data:
            self._raise_error()
            data = super().recv(size, flags)
        return data

    def getsockopt(self, level: int, option: int, *size: int) -> Any:  # type: ignore[override]
        if (level, option) != (socket.SOL_SOCKET, socket.SO_ERROR):
            return super().getsockopt(level, option, *size)
        code, self._error = self._error, 0
        return code

    def send(self, data: bytes, flags: int = 0) -> int:  # type: ignore[override]
        assert self.device is not None
        self._raise_error()
        self.device.send(data, self)
        return len(data)

    def _raise_error(self) -> None:
        code, self._error = self._error, 0
        if code:
            raise os_error(code)

    def close(self) -> None:
        if self.device and self in self.device.sockets:
            with self.device.lock:
                self.device.sockets.remove(self)
        super().close()


class FakeSocketcan:
    """Emulated SocketCAN with devices, used by python-can until it is closed."""

    def __init__(self, patch: pytest.MonkeyPatch, folder: Path) -> None:
        self.devices: dict[str, Device] = {}
        self.opened: list[DeviceSocket] = []
        self._folder = folder
        patch.setattr(can_interface, "NETWORK_DEVICES", folder)
        patch.setattr(DeviceSocket, "devices", self.devices, raising=False)
        patch.setattr(DeviceSocket, "opened", self.opened, raising=False)
        patch.setattr(upstream, "create_socket", DeviceSocket)

    def close(self) -> None:
        """Close the remaining sockets: python-can leaves a socket open that cannot be bound."""
        for one in self.opened:
            one.close()

    def add(self, name: str, fd: bool = True) -> Device:
        """Add a device that is up and return it."""
        self.devices[name] = Device(self._folder / name, fd)
        return self.devices[name]
