# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Adapter faults on the emulated adapter: disconnected, back under another name, wrong bitrate; and commands."""

from __future__ import annotations

import os
import threading
import tty
from concurrent.futures import wait
from pathlib import Path

import can
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.fault_monitor import FaultMonitor
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.slcan_codec import FLAG_OVERFLOW, FLAG_PASSIVE, REFUSED
from posfet_driver.clock import Clock
from posfet_driver.protocol.messages import Command
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.emulation.adapter_lock import is_served
from posfet_sim.emulation.bus_node import Node
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.clocks import PacedClock
from support.fake_board import PATIENCE, FakeBoard, assert_marked, read_scans, read_until, with_layout

SENSOR = with_layout(load_sensor(), 5, 5, scan_rate=200.0)


@pytest.fixture
def clock() -> PacedClock:
    return PacedClock()


def make_adapter(path: Path, clock: Clock, sensor: Sensor = SENSOR, node: Node | None = None) -> EmulatedAdapter:
    adapter = EmulatedAdapter(path, node or BoardFirmware(sensor, FakeBoard(sensor), clock.monotonic()), clock)
    adapter.open()
    return adapter


def make_board(channel: object, clock: Clock) -> tuple[Board, BusOpener]:
    opener = BusOpener(bus_settings("slcan", str(channel), SENSOR.can))
    return Board(SENSOR, opener, clock, opener.presence), opener


def test_a_second_adapter_at_the_same_link_is_rejected_until_the_first_ends(tmp_path: Path, clock: PacedClock) -> None:
    first = make_adapter(tmp_path / "can0", clock)
    try:
        assert is_served(first.link)
        with pytest.raises(SourceError, match="an emulated adapter is running here already"):
            make_adapter(tmp_path / "can0", clock)
        assert first.link.is_symlink()
    finally:
        first.close()
    assert not is_served(tmp_path / "can0")
    make_adapter(tmp_path / "can0", clock).close()


def test_a_port_without_slcan_is_reported(clock: PacedClock) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    board, _ = make_board(os.ttyname(slave), clock)
    board.open()
    try:
        os.write(master, b"$GPGGA,123519,4807.038,N\r\n" * 20)
        read_until(board, lambda: board.report().fault_counts[FaultKind.UNREADABLE] == 20)
        assert FaultKind.UNREADABLE in FaultMonitor().present(board.report(), 0)
    finally:
        board.close()
        os.close(master)
        os.close(slave)
    assert board.report().fault_counts[FaultKind.UNREADABLE] == 20  # although the port is closed


def test_an_adapter_that_returns_under_another_name_is_found(tmp_path: Path, clock: PacedClock) -> None:
    board, opener = make_board(tmp_path / "can*", clock)
    board.open()
    assert board.report().state == f"CAN bus unavailable, retrying: slcan: no port matches {tmp_path}/can*"
    try:
        for name in ("can0", "can3", "can1"):
            adapter = make_adapter(tmp_path / name, clock)
            try:
                for scan in read_scans(board, 10):
                    assert_marked(scan)
                assert opener.channel == str(tmp_path / name)
            finally:
                adapter.close()
            read_until(board, lambda: board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,))
        assert board.bus.failed == 3
    finally:
        board.close()


def test_the_port_of_the_board_is_found_among_others(tmp_path: Path, clock: PacedClock) -> None:
    """A port in use and one without a board come first."""
    other = with_layout(SENSOR, 5, 5, base_id=0x300)
    adapters = [make_adapter(tmp_path / f"can{k}", clock, sensor) for k, sensor in enumerate((SENSOR, other, SENSOR))]
    blocker = BusOpener(bus_settings("slcan", str(tmp_path / "can0"), SENSOR.can))()
    board, opener = make_board(tmp_path / "can*", clock)
    board.open()
    try:
        next(read_scans(board, 1))
        assert opener.channel == str(tmp_path / "can2")
    finally:
        board.close()
        blocker.shutdown()
        for adapter in adapters:
            adapter.close()


def test_a_wrong_bitrate_is_reported(tmp_path: Path, clock: PacedClock) -> None:
    adapter = make_adapter(tmp_path / "can0", clock)
    adapter.speeds = (b"S6", b"Y5")
    board, _ = make_board(tmp_path / "can0", clock)
    board.open()
    try:
        read_until(board, lambda: board.report().conditions == (FaultKind.BUS_ERRORS,))
        assert board.report().counters["bit errors"] > 0
        adapter.speeds = (b"S8", b"Y5")
        assert_marked(next(read_scans(board, 1)))
        assert FaultKind.BUS_ERRORS not in board.report().conditions
    finally:
        board.close()
        adapter.close()


def test_status_flags_of_the_adapter_are_reported_while_scans_flow(tmp_path: Path, clock: PacedClock) -> None:
    adapter = make_adapter(tmp_path / "can0", clock)
    board, _ = make_board(tmp_path / "can0", clock)
    board.open()
    try:
        next(read_scans(board, 1))
        assert board.bus.errors.frames == 0
        adapter.flags = FLAG_OVERFLOW | FLAG_PASSIVE
        read_until(board, lambda: board.bus.errors.frames == 2)
        assert (board.bus.errors.overflow, board.bus.errors.passive) == (2, 2)
        assert {FaultKind.ERROR_PASSIVE, FaultKind.RECEIVE_OVERFLOWS} <= set(FaultMonitor().present(board.report(), 0))
        adapter.flags = 0
        scan = list(read_scans(board, 300))[-1]
        assert board.bus.errors.frames == 2
        assert (scan.frames_lost, board.report().counters["board restarts"]) == (0, 0)
    finally:
        board.close()
        adapter.close()


class RefusingAdapter(EmulatedAdapter):
    """An adapter that has no status flags, and counts how often it is asked for them."""

    asked = 0

    def _execute(self, line: bytes, now: int) -> None:
        if line == b"F":
            self.asked += 1
            self._reply(REFUSED)
        else:
            super()._execute(line, now)


def test_an_adapter_that_refuses_to_tell_its_flags_is_asked_once(tmp_path: Path, clock: PacedClock) -> None:
    adapter = RefusingAdapter(tmp_path / "can0", BoardFirmware(SENSOR, FakeBoard(SENSOR), clock.monotonic()), clock)
    adapter.open()
    board, _ = make_board(tmp_path / "can0", clock)
    board.open()
    try:
        for scan in read_scans(board, 600):
            assert_marked(scan)
        assert adapter.asked == 1
        assert scan.frames_lost == 0
    finally:
        board.close()
        adapter.close()


@pytest.mark.parametrize("command", [Command.IDENTIFY, Command.SELF_TEST, Command.SET_RATE])
def test_commands_from_another_thread_lose_no_scans(tmp_path: Path, clock: PacedClock, command: Command) -> None:
    adapter = make_adapter(tmp_path / "can0", clock)
    board, _ = make_board(tmp_path / "can0", clock)
    board.open()
    answers = []

    def ask() -> None:
        for _ in range(20):
            argument = 5_000 if command == Command.SET_RATE else 0
            answers.append(board.submit(command, argument, PATIENCE).result(PATIENCE))

    asking = threading.Thread(target=ask)
    try:
        last = next(read_scans(board, 1)).sequence
        asking.start()
        while asking.is_alive():
            for scan in read_scans(board, 1):
                assert_marked(scan)
                assert scan.sequence == last + 1
                last = scan.sequence
        assert len(answers) == 20
        assert board.restarted == board.decoder.frames_lost == 0
    finally:
        asking.join()
        board.close()
        adapter.close()


def test_pending_commands_fail_when_the_bus_disconnects(tmp_path: Path, clock: PacedClock) -> None:
    firmware = BoardFirmware(SENSOR, FakeBoard(SENSOR), clock.monotonic())
    adapter = make_adapter(tmp_path / "can0", clock, node=firmware)
    board, _ = make_board(tmp_path / "can0", clock)
    board.open()
    ignored: list[Frame] = []

    def ignore(frame: Frame, now: int) -> list[Frame]:
        ignored.append(frame)
        return []

    try:
        next(read_scans(board, 1))
        firmware.receive = ignore
        commands = [board.submit(Command.IDENTIFY, timeout=PATIENCE) for _ in range(3)]
        read_until(board, lambda: len(ignored) > 0)
        adapter.close()
        read_until(board, lambda: all(command.done() for command in commands))
        assert not wait(commands, 0).not_done
        for command in commands:
            with pytest.raises(CommandError, match="IDENTIFY: CAN bus unavailable, retrying"):
                command.result()
    finally:
        board.close()


class PassiveBus(can.BusABC):
    """A python-can bus with a settable controller state."""

    channel_info = "passive"
    _can_protocol = can.CanProtocol.CAN_FD

    def __init__(self, state: can.BusState) -> None:
        super().__init__("passive")
        self._state = state

    @property
    def state(self) -> can.BusState:
        return self._state

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        pass

    def _recv_internal(self, timeout: float | None) -> tuple[None, bool]:
        return None, False


def test_the_bus_state_of_python_can_is_reported_as_an_error_frame() -> None:

    for state, frames in ((can.BusState.ACTIVE, 0), (can.BusState.PASSIVE, 1), (can.BusState.ERROR, 1)):
        bus = PythonCanFrameBus(PassiveBus(state))
        bus.ask_state()
        assert len(bus.read_frames(0)) == frames
        bus.shutdown()
