# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver on the reference firmware, each on its own socket of a real kernel."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.faults import Health
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.protocol.messages import Command
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import ScanStatus
from support.fake_board import PATIENCE, read_scans, read_until, with_fd, with_layout
from support.reference_board import TerminalBoard, make, terminal_board

pytestmark = pytest.mark.vm
RATE = 50.0
"""Scan rate [Hz] that an emulated processor sustains."""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("firmware")
    make(folder, "all")
    return folder / "posfet_board"


@pytest.fixture
def hardware(program: Path, wire: Any) -> Iterator[TerminalBoard]:
    form = "fd" if wire.fd else "classic"
    with terminal_board(program, "--can", wire.board.name, "--format", form, "--boot", "5") as hardware:
        assert hardware.port == wire.board.name
        yield hardware


@pytest.fixture
def board(wire: Any) -> Iterator[Board]:
    sensor = with_fd(with_layout(load_sensor(), 5, 5, scan_rate=RATE), wire.fd)
    opener = BusOpener(bus_settings("socketcan", wire.driver.name, sensor.can))
    board = Board(sensor, opener, presence=opener.presence)
    board.open()
    yield board
    board.close()


def test_scans_arrive_and_commands_are_answered(hardware: TerminalBoard, board: Board, wire: Any) -> None:
    sequences = [scan.sequence for scan in read_scans(board, 50)]
    assert all(after == before + 1 for before, after in pairwise(sequences))
    stopped = board.request(Command.STOP, timeout=PATIENCE).value
    assert board.request(Command.SELF_TEST, timeout=PATIENCE).value == 0
    assert board.request(Command.IDENTIFY, timeout=PATIENCE).value == 0x0102_0001 | wire.fd << 20
    assert board.request(Command.START, timeout=PATIENCE).value >= stopped
    (scan,) = read_scans(board, 1)
    assert scan.sequence >= stopped
    hardware.power_cycle()
    while not scan.status & ScanStatus.BOARD_RESET:
        (scan,) = read_scans(board, 1)
    read_until(board, lambda: board.report().health == Health.OK)
