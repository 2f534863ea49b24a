# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Larger arrays, several boards and buses, and high bus load: end to end without loss."""

from __future__ import annotations

import uuid
from contextlib import ExitStack
from pathlib import Path

import can
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.bus.frame_timing import fd_time
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.emulation.bus_node import Node
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.clocks import PacedClock
from support.fake_board import FakeBoard, assert_marked, board_on_bus, read_scans, with_fd, with_layout
from support.fault_injector import FaultInjector, InjectedFault

SHIPPED = ["posfet_5x5", "posfet_16x16", "posfet_32x32"]


def firmware(sensor: Sensor, now: int) -> BoardFirmware:
    return BoardFirmware(sensor, FakeBoard(sensor), now)


@pytest.fixture
def clock() -> PacedClock:
    return PacedClock()


def connected_adapter(stack: ExitStack, path: Path, node: Node, clock: Clock) -> EmulatedAdapter:
    adapter = EmulatedAdapter(path, node, clock)
    adapter.open()
    stack.callback(adapter.close)
    return adapter


def opened(stack: ExitStack, sensor: Sensor, interface: str, channel: object, clock: Clock) -> Board:
    opener = BusOpener(bus_settings(interface, str(channel), sensor.can))
    board = Board(sensor, opener, clock)
    stack.callback(board.close)
    board.open()
    return board


def check_scans(board: Board, count: int) -> None:
    """Check that the next scans are consecutive, as sent, and that none was lost."""
    sequences = []
    for scan in read_scans(board, count):
        assert_marked(scan)
        sequences.append(scan.sequence)
    assert sequences == list(range(sequences[0], sequences[0] + count))
    assert board.report().frames_lost == 0


@pytest.mark.parametrize("name", SHIPPED)
def test_scans_of_every_shipped_array_are_received_completely(tmp_path: Path, clock: PacedClock, name: str) -> None:
    sensor = load_sensor(name)
    with ExitStack() as stack:
        connected_adapter(stack, tmp_path / "can0", firmware(sensor, clock.monotonic()), clock)
        check_scans(opened(stack, sensor, "slcan", tmp_path / "can0", clock), round(sensor.can.scan_rate))


@pytest.mark.parametrize("name", SHIPPED)
def test_the_bus_load_of_every_shipped_array_is_feasible(name: str) -> None:
    sensor = load_sensor(name)
    frame = fd_time(64, sensor.can.bitrate, sensor.can.data_bitrate).most
    assert make_codec(sensor).blocks * frame * sensor.can.scan_rate < 0.95


def test_shipped_arrays_have_distinct_layout_ids() -> None:
    layouts = [load_sensor(name).layout for name in SHIPPED]
    assert len({layout.id for layout in layouts}) == len(SHIPPED)
    assert [(layout.rows, layout.cols) for layout in layouts] == [(5, 5), (16, 16), (32, 32)]


def test_three_boards_share_a_bus_and_two_more_have_separate_buses(tmp_path: Path, clock: PacedClock) -> None:
    sensors = [with_layout(load_sensor(), 5, 5, scan_rate=100.0, base_id=0x100 + 0x10 * k) for k in range(3)]
    channel, now = uuid.uuid4().hex, clock.monotonic()
    with ExitStack() as stack:
        boards = []
        for sensor in sensors:
            far_end = stack.enter_context(can.Bus(interface="virtual", channel=channel))
            stack.enter_context(board_on_bus(far_end, firmware(sensor, now), clock))
        boards += [opened(stack, sensor, "virtual", channel, clock) for sensor in sensors]
        for k in (0, 1):
            connected_adapter(stack, tmp_path / f"can{k}", firmware(sensors[0], now), clock)
            boards.append(opened(stack, sensors[0], "slcan", tmp_path / f"can{k}", clock))
        for _ in range(10):
            for board in boards:
                check_scans(board, 5)
        unrelated = [board.decoder.traffic.unrelated > 0 for board in boards]
        assert unrelated == [True] * 3 + [False] * 2


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_high_bus_load_of_unrelated_frames_loses_no_scans(tmp_path: Path, clock: PacedClock, fd: bool) -> None:
    """100 % load of a classic bus in addition to scans at 1 kHz: more than any bus can carry."""
    sensor, now = with_fd(load_sensor(), fd), clock.monotonic()
    injector = FaultInjector(lambda at: BoardFirmware(sensor, FakeBoard(sensor), at), sensor.can.base_id, now)
    injector.fault = InjectedFault.UNRELATED
    with ExitStack() as stack:
        adapter = connected_adapter(stack, tmp_path / "can0", injector, clock)
        opener = BusOpener(bus_settings("slcan", str(tmp_path / "can0"), sensor.can))
        board = Board(sensor, opener, clock)
        stack.callback(board.close)
        board.open()
        check_scans(board, 2000)
        assert board.decoder.traffic.unrelated > 8 * 2000
        assert adapter.frames_dropped == 0


LIMIT = with_layout(load_sensor(), 5, 5, scan_rate=8000.0)
"""5 x 5 at 8 kHz: more than the frames' time on the bus allows."""
REAL_TIME = 10_000_000_000
"""Duration of the run in real time [ns]."""


def test_can_fd_at_the_maximum_frame_rate_loses_no_scans(tmp_path: Path) -> None:
    clock = PacedClock(lead=0.002)  # 2 KiB
    assert 1 / fd_time(64, LIMIT.can.bitrate, LIMIT.can.data_bitrate).least < LIMIT.can.scan_rate
    with ExitStack() as stack:
        adapter = connected_adapter(stack, tmp_path / "can0", firmware(LIMIT, clock.monotonic()), clock)
        check_scans(opened(stack, LIMIT, "slcan", tmp_path / "can0", clock), 4000)
        assert adapter.frames_dropped == 0


@pytest.mark.slow
def test_each_scan_at_the_maximum_rate_in_real_time_is_read_or_missed_by_board_or_adapter(
    tmp_path: Path,
) -> None:
    """With reader and adapter in one process; how many they can handle in time depends on the machine."""
    clock = SystemClock()
    with ExitStack() as stack:
        node = firmware(LIMIT, clock.monotonic())
        adapter = connected_adapter(stack, tmp_path / "can0", node, clock)
        board = opened(stack, LIMIT, "slcan", tmp_path / "can0", clock)
        first = last = next(read_scans(board, 1)).sequence
        end = clock.monotonic() + REAL_TIME
        while clock.monotonic() < end:
            if scan := board.read(0.1):
                assert_marked(scan)
                last = scan.sequence
        losses = board.decoder.statistics
        assert board.decoder.scans + losses.lost_scans == last - first + 1
        if board.bus.opened == 1:  # a driver that had to wait too long has opened it again, without what was on the way
            assert losses.lost_scans <= adapter.frames_dropped + node.missed
        assert losses.incomplete_scans == losses.late == losses.duplicate == 0
