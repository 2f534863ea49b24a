# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What CAN sockets do, for a comparison of the fake kernel (fake_socketcan) with a real one."""

from __future__ import annotations

import errno
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from can.interfaces.socketcan import socketcan

from posfet_driver.bus.frame import CLASSIC, EXTENDED, REMOTE
from posfet_driver.bus.open_bus import BusSettings, open_bus
from posfet_driver.protocol.identifiers import board_frames
from posfet_model.sensor.description import load_sensor
from support.fake_board import PATIENCE, with_layout

_FRAME = struct.Struct("=IB3x8s")
LAST = _FRAME.pack(0x7FF, 8, b"the last")
EXTENDED_FLAG, REMOTE_FLAG = 0x8000_0000, 0x4000_0000


@contextmanager
def bound(name: str) -> Iterator[socket.socket]:
    """Yield a socket that is bound to an interface."""
    with closing(socketcan.create_socket()) as one:
        one.bind((name,))
        yield one


def outcome(action: Callable[..., object], *arguments: object) -> object:
    """Return the result of a call, or the name of its error."""
    try:
        return action(*arguments)
    except OSError as error:
        return errno.errorcode[error.errno or 0]


def received(reader: socket.socket) -> list[bytes]:
    """Return the frames up to the last one."""
    reader.settimeout(PATIENCE)
    frames: list[bytes] = []
    while LAST not in frames:
        frames.append(reader.recv(72))
    return frames[:-1]


def down_and_up(name: str, switch: Callable[[bool], None]) -> list[object]:
    """Return what two sockets experience while an interface that is up goes down and up; it ends up."""
    frame, now = _FRAME.pack(0x123, 8, b"12345678"), socket.MSG_DONTWAIT
    switch(False)
    with bound(name) as early:
        results = [outcome(early.recv, 72, now), outcome(early.recv, 72, now), outcome(early.send, frame)]
        switch(True)
        with bound(name) as late:
            results += [outcome(late.send, frame), outcome(early.recv, 72), outcome(early.recv, 72, now)]
            switch(False)
            results += [outcome(late.send, frame), outcome(late.recv, 72, now)]
            switch(True)
            results += [outcome(early.send, frame), outcome(early.send, frame), outcome(late.recv, 72)]
    return results


def stalled_queue(name: str, stall: Callable[[bool], None]) -> tuple[int, object, int]:
    """Return how many frames a stalled queue takes, the error of the next, and how many a later socket receives."""
    stall(True)
    taken, result = 0, None
    with bound(name) as sender:
        while not isinstance(result := outcome(sender.send, _FRAME.pack(0x123, 8, bytes(8))), str):
            taken += 1
    with bound(name) as late, bound(name) as other:
        stall(False)
        while isinstance(outcome(other.send, LAST), str):
            pass
        return taken, result, len(received(late))


def filtered(name: str, base: int) -> list[tuple[int, int]]:
    """Return identifier and kind of the frames that the driver's bus receives: at first, then of its board alone."""
    sensor = with_layout(load_sensor(), 5, 5, fd=False, base_id=base)
    bus = open_bus(BusSettings("socketcan", name, 1_000_000, 5_000_000, fd=False), board_frames(sensor))
    found: list[tuple[int, int]] = []
    with bound(name) as sender:
        for _ in range(2):
            for identifier in range(base - 4, base + 24):
                for flags in (0, EXTENDED_FLAG, REMOTE_FLAG):
                    sender.send(_FRAME.pack(identifier | flags, 8, bytes(8)))
            sender.send(_FRAME.pack(base + 1, 8, LAST[8:]))
            data = b""
            while data != LAST[8:]:
                for identifier, kind, data in bus.read_frames(PATIENCE):  # noqa: B007
                    found.append((identifier, kind))
    bus.shutdown()
    assert {kind for _, kind in found} <= {CLASSIC, EXTENDED, REMOTE}
    return found
