"""SocketCAN for kernels without it: python-can's own SocketcanBus on datagrams in the format of its frames.

Buffers, timestamps and the count of dropped frames are those of UDP on loopback. Filters, error frames and a full queue
are emulated here. Real SocketCAN is tested with POSFET_TEST_CAN (test_hardware.py).
"""

from __future__ import annotations

import errno
import os
import socket
import threading
from pathlib import Path
from typing import Any

import pytest
from can.interfaces.socketcan import constants
from can.interfaces.socketcan import socketcan as upstream

from posfet_driver.bus import socketcan_bus


class Device:
    """A network device: every socket on it receives the frames that the others send."""

    def __init__(self, folder: Path) -> None:
        self.sockets: list[DeviceSocket] = []
        self.lock = threading.Lock()  # no socket is closed while another thread sends to it
        self.queue_full = False
        """Whether the send queue is full, as without any acknowledging node."""
        self._folder = folder
        folder.mkdir(parents=True)
        self.carrier(True)

    def carrier(self, on: bool) -> None:
        """Set the controller on or off the bus."""
        (self._folder / "carrier").write_text(f"{int(on)}\n", encoding="ascii")
        (self._folder / "operstate").write_text("up\n" if on else "down\n", encoding="ascii")

    def deliver(self, data: bytes, sender: DeviceSocket | None = None) -> None:
        """Deliver a frame, in the format of the kernel, to the sockets."""
        with self.lock:
            for other in self.sockets:
                if other is not sender:
                    other.sendto(data, other.getsockname())


class DeviceSocket(socket.socket):
    """A CAN socket emulated by a UDP socket."""

    devices: dict[str, Device]
    opened: list[DeviceSocket]
    device: Device | None = None

    def __init__(self) -> None:
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        super().bind(("127.0.0.1", 0))
        self.opened.append(self)

    def setsockopt(self, level: int, option: int, value: Any) -> None:  # type: ignore[override]
        if level != constants.SOL_CAN_RAW:
            super().setsockopt(level, option, value)

    def bind(self, address: tuple[str]) -> None:  # type: ignore[override]
        if address[0] not in self.devices:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        self.device = self.devices[address[0]]
        self.device.sockets.append(self)

    def send(self, data: bytes, flags: int = 0) -> int:  # type: ignore[override]
        assert self.device is not None
        if self.device.queue_full:
            raise OSError(errno.ENOBUFS, os.strerror(errno.ENOBUFS))
        self.device.deliver(data, self)
        return len(data)

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
        patch.setattr(socketcan_bus, "NETWORK_DEVICES", folder)
        patch.setattr(DeviceSocket, "devices", self.devices, raising=False)
        patch.setattr(DeviceSocket, "opened", self.opened, raising=False)
        patch.setattr(upstream, "create_socket", DeviceSocket)

    def close(self) -> None:
        """Close the remaining sockets: python-can leaves a socket open that cannot be bound."""
        for one in self.opened:
            one.close()

    def add(self, name: str) -> Device:
        """Add a device and return it."""
        self.devices[name] = Device(self._folder / name)
        return self.devices[name]
