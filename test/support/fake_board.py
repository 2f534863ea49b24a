# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board whose counts encode their scan, so that a scan mixed from two is detected."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import can
import numpy as np

from posfet_driver.board.board_client import Board
from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.clock import Clock, SystemClock
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import POLL

PATIENCE = 120.0
"""Time-out for an event [s]: no machine is that slow."""


def marked_counts(index: int, taxels: int) -> np.ndarray:
    """Return 12-bit codes on the 16-bit scale, different for any two scans less than 4096 apart."""
    codes = (index * 7 + np.arange(taxels) * 129) % 4096
    return (codes << 4 | codes >> 8).astype(np.uint16)


class FakeBoard:
    """Source of marked scans; stores the status to be sent."""

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        self.status = 0
        self.temperature = 23.5

    def scan(self, index: int, out: Scan) -> None:
        out.counts[:] = marked_counts(index, self.sensor.layout.taxels)
        out.device_time = round(index / self.sensor.can.scan_rate * 1e6)
        out.temperatures[:] = self.temperature
        out.status = self.status


def assert_marked(scan: Scan) -> None:
    """Assert that all counts of a scan are those of its sequence number."""
    np.testing.assert_array_equal(scan.counts, marked_counts(scan.sequence, len(scan.counts)))


def with_fd(sensor: Sensor, fd: bool) -> Sensor:
    """Return the sensor with a board that sends CAN FD or classic frames."""
    return replace(sensor, can=replace(sensor.can, fd=fd))


def with_layout(sensor: Sensor, rows: int, cols: int, **link: object) -> Sensor:
    """Return the sensor with another layout and CAN link."""
    layout = replace(sensor.layout, rows=rows, cols=cols)
    return replace(sensor, layout=layout, can=replace(sensor.can, **link))


def block_kind(fd: bool) -> int:
    """Return the kind of the frames that carry scans."""
    return FD | RATE_SWITCH if fd else CLASSIC


def make_scan(sensor: Sensor, sequence: int, time: int | None = None) -> Scan:
    """Return the marked scan of a sequence number."""
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    FakeBoard(sensor).scan(sequence, scan)
    scan.sequence = sequence
    if time is not None:
        scan.device_time = time
    return scan


def slcan_opener(path: object, fd: bool = True) -> Callable[[], SlcanBus]:
    """Return a function that opens the slcan bus at `path`."""
    return lambda: SlcanBus(str(path), bitrate=1_000_000, data_bitrate=5_000_000, fd=fd)


def read_scans(board: Board, count: int) -> Iterator[Scan]:
    """Yield the next scans, each valid until the next one; fail after a time-out."""
    clock = SystemClock()
    end = clock.monotonic() + round(PATIENCE * 1e9)
    for _ in range(count):
        while (scan := board.read(0.1)) is None:
            assert clock.monotonic() < end, board.report()
        yield scan


def read_until(board: Board, condition: Callable[[], bool]) -> None:
    """Read and discard scans until the condition holds; fail after a time-out."""
    clock = SystemClock()
    end = clock.monotonic() + round(PATIENCE * 1e9)
    while not condition():
        board.read(0.02)
        assert clock.monotonic() < end, board.report()


@contextmanager
def board_on_bus(bus: can.BusABC, firmware: BoardFirmware, clock: Clock) -> Iterator[None]:
    """Serve `firmware` on a python-can bus in a thread."""
    stop = threading.Event()

    def send(frames: list[Frame]) -> None:
        for frame in frames:
            bus.send(message_of(frame))

    def run() -> None:
        while not stop.is_set():
            message = bus.recv(min(max((firmware.next_due() - clock.monotonic()) / 1e9, 0.0), POLL))
            now = clock.monotonic()
            send(firmware.due(now))
            if message is not None:
                send(firmware.receive(frame_of(message), now))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
