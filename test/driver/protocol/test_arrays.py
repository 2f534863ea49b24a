"""Larger arrays, several boards, several buses, and a bus that others fill: end to end, nothing lost."""

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
from posfet_driver.clock import SystemClock
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.emulation import slcan_adapter
from posfet_sim.emulation.bus_node import Node
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.fake_board import FakeBoard, assert_marked, board_on_bus, read_scans, with_fd, with_layout
from support.fault_injector import FaultInjector, Trouble

SHIPPED = ["posfet_5x5", "posfet_16x16", "posfet_32x32"]


def firmware(sensor: Sensor, now: int) -> BoardFirmware:
    return BoardFirmware(sensor, FakeBoard(sensor), now)


def plugged_in(stack: ExitStack, path: Path, node: Node) -> EmulatedAdapter:
    adapter = EmulatedAdapter(path, node)
    adapter.open()
    stack.callback(adapter.close)
    return adapter


def opened(stack: ExitStack, sensor: Sensor, interface: str, channel: object) -> Board:
    opener = BusOpener(bus_settings(interface, str(channel), sensor.can))
    board = Board(sensor, opener)
    stack.callback(board.close)
    board.open()
    return board


def check_run(board: Board, count: int) -> None:
    """The next scans are those that were sent, one after the other, and nothing was lost."""
    sequences = []
    for scan in read_scans(board, count):
        assert_marked(scan)
        sequences.append(scan.sequence)
    assert sequences == list(range(sequences[0], sequences[0] + count))
    assert board.report().frames_lost == 0


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_array_arrives_whole(tmp_path: Path, name: str) -> None:
    sensor = load_sensor(name)
    with ExitStack() as stack:
        plugged_in(stack, tmp_path / "can0", firmware(sensor, SystemClock().monotonic()))
        check_run(opened(stack, sensor, "slcan", tmp_path / "can0"), round(sensor.can.scan_rate))


@pytest.mark.parametrize("name", SHIPPED)
def test_the_bus_carries_the_rate_of_every_shipped_array(name: str) -> None:
    sensor = load_sensor(name)
    frame = fd_time(64, sensor.can.bitrate, sensor.can.data_bitrate).most
    assert make_codec(sensor).blocks * frame * sensor.can.scan_rate < 0.95


def test_shipped_arrays_have_layouts_of_their_own() -> None:
    layouts = [load_sensor(name).layout for name in SHIPPED]
    assert len({layout.id for layout in layouts}) == len(SHIPPED)
    assert [(layout.rows, layout.cols) for layout in layouts] == [(5, 5), (16, 16), (32, 32)]


def test_three_boards_on_one_bus_and_two_more_on_buses_of_their_own(tmp_path: Path) -> None:
    sensors = [with_layout(load_sensor(), 5, 5, scan_rate=100.0, base_id=0x100 + 0x10 * k) for k in range(3)]
    channel, now = uuid.uuid4().hex, SystemClock().monotonic()
    with ExitStack() as stack:
        boards = []
        for sensor in sensors:
            far_end = stack.enter_context(can.Bus(interface="virtual", channel=channel))
            stack.enter_context(board_on_bus(far_end, firmware(sensor, now)))
        boards += [opened(stack, sensor, "virtual", channel) for sensor in sensors]
        for k in (0, 1):
            plugged_in(stack, tmp_path / f"can{k}", firmware(sensors[0], now))
            boards.append(opened(stack, sensors[0], "slcan", tmp_path / f"can{k}"))
        for _ in range(10):
            for board in boards:
                check_run(board, 5)
        foreign = [board.decoder.traffic.unrelated > 0 for board in boards]
        assert foreign == [True] * 3 + [False] * 2


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_a_bus_full_of_foreign_frames_costs_no_scan(tmp_path: Path, fd: bool) -> None:
    """100 % of a classic bus beside 1 kHz of ours: more than any bus can carry."""
    sensor, now = with_fd(load_sensor(), fd), SystemClock().monotonic()
    injector = FaultInjector(lambda at: BoardFirmware(sensor, FakeBoard(sensor), at), sensor.can.base_id, now)
    injector.trouble = Trouble.FOREIGN
    with ExitStack() as stack:
        adapter = plugged_in(stack, tmp_path / "can0", injector)
        opener = BusOpener(bus_settings("slcan", str(tmp_path / "can0"), sensor.can))
        board = Board(sensor, opener)
        stack.callback(board.close)
        board.open()
        check_run(board, 2000)
        assert board.decoder.traffic.unrelated > 8 * 2000
        assert adapter.frames_dropped == 0


def test_can_fd_at_the_limit_of_the_wire_costs_no_scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """8 kHz of 5 x 5: more than the frames' time on the bus allows, with a reader and an adapter in one process."""
    monkeypatch.setattr(slcan_adapter, "OUTPUT_LIMIT", 1 << 24)  # a busy machine is held up for long
    sensor = with_layout(load_sensor(), 5, 5, scan_rate=8000.0)
    assert 1 / fd_time(64, sensor.can.bitrate, sensor.can.data_bitrate).least < 8000.0
    with ExitStack() as stack:
        adapter = plugged_in(stack, tmp_path / "can0", firmware(sensor, SystemClock().monotonic()))
        board = opened(stack, sensor, "slcan", tmp_path / "can0")
        check_run(board, 8000)
        assert adapter.frames_dropped == 0
