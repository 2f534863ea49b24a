# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A marked board and the driver on the two ends of a wire of a real kernel, on the clock of the machine."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType

from posfet_driver.board.board_client import Board
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.bus.open_bus import BusSettings, bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import SystemClock
from posfet_driver.protocol.identifiers import board_frames
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.bus_server import BusServer
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import FakeBoard, assert_marked, read_scans, read_until, with_fd, with_layout
from support.kernel_can import Interface, Wire

RATE = 100.0
"""Scan rate [Hz]: the emulated processor is some twenty times slower than a real one."""


class VmBench:
    """A board that serves its interface from `__enter__` on, and the driver's client, open."""

    def __init__(self, wire: Wire, rate: float = RATE) -> None:
        clock = SystemClock()
        self.sensor = with_fd(with_layout(load_sensor(), 5, 5, scan_rate=rate), wire.fd)
        self.firmware = BoardFirmware(self.sensor, FakeBoard(self.sensor), clock.monotonic())
        self.server = BusServer(self.settings(wire.board), self.firmware, clock)
        opener = BusOpener(self.settings(wire.driver), board_frames(self.sensor))
        self.board = Board(self.sensor, opener, clock, opener.presence)

    def settings(self, interface: Interface) -> BusSettings:
        return bus_settings("socketcan", interface.name, self.sensor.can)

    def __enter__(self) -> VmBench:
        self.server.open()
        self.board.open()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.board.close()
        self.server.close()

    @property
    def conditions(self) -> tuple[FaultKind, ...]:
        return self.board.report().conditions

    @property
    def state(self) -> str:
        return self.board.report().state

    def count(self, fault: FaultKind) -> int:
        return self.board.report().fault_counts[fault]

    def scans(self, count: int = 10) -> list[int]:
        """Read scans and return their sequences; all are whole."""
        sequences = []
        for scan in read_scans(self.board, count):
            assert_marked(scan)
            sequences.append(scan.sequence)
        return sequences

    def until(self, condition: Callable[[], bool]) -> None:
        read_until(self.board, condition)

    def until_healthy(self) -> None:
        """Read until scans arrive and no fault is present."""
        self.until(lambda: (self.board.report().health, self.conditions) == (Health.OK, ()))
        self.scans()
