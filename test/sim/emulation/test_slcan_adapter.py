# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The whole link: firmware, emulated adapter on a pseudo-terminal, slcan bus, board client."""

from __future__ import annotations

import gc
import os
import select
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.frame import CLASSIC, ERROR, Frame
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.open_bus import bus_settings, open_bus
from posfet_driver.bus.reconnecting_bus import ReconnectingBus
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request, Result
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import ScanStatus
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.clocks import PacedClock
from support.fake_board import (
    PATIENCE,
    FakeBoard,
    assert_marked,
    read_scans,
    read_until,
    slcan_opener,
    with_fd,
    with_layout,
)
from support.frame_examples import FRAMES


class Echo:
    """A bus node that echoes every frame."""

    def next_due(self) -> int:
        return 1 << 62

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        return []

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        return [frame]


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "can0"


@pytest.fixture
def clock() -> PacedClock:
    return PacedClock()


@pytest.fixture
def echo(link: Path, clock: PacedClock) -> Iterator[EmulatedAdapter]:
    adapter = EmulatedAdapter(link, Echo(), clock)
    adapter.open()
    yield adapter
    adapter.close()


def require_slcan(fd: bool) -> None:
    """Skip if the slcan implementation of python-can lacks what the test needs."""
    pytest.importorskip("serial", reason="needs pyserial")
    slcan = pytest.importorskip("can.interfaces.slcan")
    if fd and not hasattr(slcan.slcanBus, "_DATA_BITRATES"):
        pytest.skip("python-can's own slcan has CAN FD from 4.5 on")


def firmware_for(sensor: Sensor, fd: bool, clock: Clock) -> BoardFirmware:
    return BoardFirmware(with_fd(sensor, fd), FakeBoard(sensor), clock.monotonic())


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_scans_are_complete_in_order_and_without_loss(sensor: Sensor, link: Path, fd: bool) -> None:
    clock = PacedClock(lead=0.003)  # few enough scans at once that a classic counter is never ambiguous
    adapter = EmulatedAdapter(link, firmware_for(sensor, fd, clock), clock)
    adapter.open()
    board = Board(with_fd(sensor, fd), slcan_opener(link), clock)
    board.open()
    try:
        expected = None
        for scan in read_scans(board, 600):
            assert_marked(scan)
            first = expected is None
            assert scan.status == ScanStatus.OK
            assert first or scan.sequence == expected
            expected = scan.sequence + 1
            assert scan.frames_lost == 0
            assert scan.device_time == round(scan.sequence * 1e6 / sensor.can.scan_rate)
        np.testing.assert_array_equal(board.decoder.scan.temperatures, [23.5, 23.5])
        report = board.report()
        assert report.health == Health.OK
        assert report.values["firmware"] == "1.0"
        assert not any(report.fault_counts.values())
        assert not any(report.counters.values())
        assert adapter.frames_dropped == 0
    finally:
        board.close()
        adapter.close()
    assert not link.is_symlink()


def test_scans_of_a_large_array_are_complete(sensor: Sensor, link: Path, clock: PacedClock) -> None:
    sensor = with_layout(sensor, 32, 32, scan_rate=200.0)
    adapter = EmulatedAdapter(link, firmware_for(sensor, True, clock), clock)
    adapter.open()
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    try:
        sequences = []
        for scan in read_scans(board, 50):
            assert_marked(scan)
            sequences.append(scan.sequence)
        assert sequences == list(range(sequences[0], sequences[0] + 50))
        assert board.report().frames_lost == 0
    finally:
        board.close()
        adapter.close()


def test_scans_resume_after_the_adapter_disconnects_and_returns(sensor: Sensor, link: Path, clock: PacedClock) -> None:
    """Not yet present, present, unplugged, back at the same path with a reset board."""
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    assert board.report().health == Health.ERROR
    assert "No such file or directory" in board.report().state
    adapters = []
    try:
        for round_trip in range(3):
            adapter = EmulatedAdapter(link, firmware_for(sensor, True, clock), clock)
            adapter.open()
            adapters.append(adapter)
            for scan in read_scans(board, 20):
                assert_marked(scan)
                assert scan.sequence < 20_000  # each board counts from its start
            adapter.close()
            read_until(board, lambda: board.report().health == Health.ERROR)
            assert board.bus.failed == round_trip + 1
            assert board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,)
    finally:
        board.close()
        for adapter in adapters:
            adapter.close()


def test_a_board_that_stops_sending_is_restarted(sensor: Sensor, link: Path, clock: PacedClock) -> None:
    firmware = firmware_for(sensor, True, clock)
    adapter = EmulatedAdapter(link, firmware, clock)
    adapter.open()
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    try:
        list(read_scans(board, 3))
        firmware.running = False  # as after a brown-out
        read_until(board, lambda: board.restarted > 0)
        for scan in read_scans(board, 3):
            assert_marked(scan)
        assert board.report().fault_counts[FaultKind.LOST_SCANS] > 0
    finally:
        board.close()
        adapter.close()


def test_commands_are_accepted_or_rejected_with_a_reason(sensor: Sensor, link: Path, clock: PacedClock) -> None:
    fake = FakeBoard(sensor)
    firmware = BoardFirmware(sensor, fake, clock.monotonic())
    adapter = EmulatedAdapter(link, firmware, clock)
    adapter.open()
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    try:
        list(read_scans(board, 3))
        assert board.request(Command.STOP, timeout=PATIENCE).result == Result.OK
        assert not firmware.running
        assert board.request(Command.IDENTIFY, timeout=PATIENCE).value & 0xFFFF == sensor.layout.id
        with pytest.raises(CommandError, match="SET_RATE: refused by the board: bad argument"):
            board.request(Command.SET_RATE, 10, timeout=PATIENCE)
        assert board.request(Command.SET_RATE, 5000, timeout=PATIENCE).value == 5000
        assert not firmware.running
        board.request(Command.START, timeout=PATIENCE)
        times = [scan.device_time for scan in read_scans(board, 10)]
        assert set(np.diff(times)) == {5000}
        assert board.report().frames_lost == 0
        fake.status = ScanStatus.ADC_FAULT
        next(read_scans(board, 1))
        list(read_scans(board, 10))
        with pytest.raises(CommandError, match=r"SELF_TEST: refused by the board: failed \(value 2\)"):
            board.request(Command.SELF_TEST, timeout=PATIENCE)
    finally:
        board.close()
        adapter.close()


def test_a_command_without_a_response_times_out(sensor: Sensor, echo: EmulatedAdapter, clock: PacedClock) -> None:
    board = Board(sensor, slcan_opener(echo.link), clock)
    with pytest.raises(CommandError, match="STOP: closed"):
        board.request(Command.STOP)
    board.open()
    try:
        with pytest.raises(CommandError, match=r"STOP: the board was not ready within 0\.05 s: looking for the board"):
            board.request(Command.STOP, timeout=0.05)
        read_until(board, lambda: "no board responds at base identifier 0x100" in board.report().state)
    finally:
        board.close()


def test_a_board_of_another_layout_is_reported_and_not_read(sensor: Sensor, link: Path, clock: PacedClock) -> None:
    other = replace(sensor, layout=replace(sensor.layout, id=7))
    adapter = EmulatedAdapter(link, firmware_for(other, True, clock), clock)
    adapter.open()
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    try:
        read_until(board, lambda: board.report().state == "the board has layout 7, the sensor file 1")
        assert board.report().health == Health.ERROR
        assert board.report().scans == 0
    finally:
        board.close()
        adapter.close()


@pytest.mark.parametrize("frame", FRAMES, ids=str)
def test_slcan_bus_sends_and_receives_every_frame_type(echo: EmulatedAdapter, frame: Frame) -> None:
    with SlcanBus(str(echo.link), bitrate=1_000_000, data_bitrate=5_000_000, fd=True) as bus:
        bus.send(message_of(frame))
        received = bus.recv(PATIENCE)
        assert received is not None
        assert frame_of(received) == frame
        assert bus.recv(0) is None
        assert bus.unreadable == 0


def test_both_slcan_buses_receive_the_same_frames(echo: EmulatedAdapter) -> None:
    """Both on the same adapter in turn, at a rate that python-can sustains."""
    require_slcan(fd=True)
    timing = can.BitTimingFd(80_000_000, 2, 31, 8, 8, 1, 12, 3, 3)
    received = []
    for opener in (
        slcan_opener(echo.link),
        lambda: can.Bus(interface="slcan", channel=str(echo.link), timing=timing, sleep_after_open=0),
    ):
        with opener() as bus:
            messages = []
            for frame in FRAMES:
                bus.send(message_of(frame))
                messages.append(bus.recv(PATIENCE))
            received.append(messages)
    for ours, theirs in zip(*received, strict=True):
        assert ours is not None
        assert ours.equals(theirs, timestamp_delta=None, check_channel=False)


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_a_board_is_read_through_python_cans_own_slcan(sensor: Sensor, link: Path, clock: PacedClock, fd: bool) -> None:
    require_slcan(fd)
    sensor = with_layout(sensor, 5, 5, scan_rate=25.0)
    adapter = EmulatedAdapter(link, firmware_for(sensor, fd, clock), clock)
    adapter.open()
    settings = bus_settings("slcan-python-can", str(link), sensor.can, options=["sleep_after_open=0"])
    board = Board(with_fd(sensor, fd), lambda: open_bus(settings), clock)
    board.open()
    try:
        sequences = []
        for scan in read_scans(board, 10):
            assert_marked(scan)
            sequences.append(scan.sequence)
        assert sequences == list(range(sequences[0], sequences[0] + 10))
    finally:
        board.close()
        adapter.close()


def serial_exchange(link: Path, line: bytes, expected: bytes) -> None:
    """Write a line to the terminal directly, and wait for the reply."""
    port = os.open(link, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(port, line)
        reply = b""
        while len(reply) < len(expected):
            assert select.select([port], [], [], PATIENCE)[0], reply
            reply += os.read(port, 4096)
        assert reply == expected
    finally:
        os.close(port)


def test_the_adapter_replies_as_documented(echo: EmulatedAdapter) -> None:
    for line, reply in [
        (b"C\r", b"\r"),
        (b"V\r", b"V1013\r"),
        (b"N\r", b"NPSFT\r"),
        (b"F\r", b"F00\r"),
        (b"t1231FF\r", b"\a"),  # the channel is closed
        (b"S8\r", b"\r"),
        (b"Y5\r", b"\r"),
        (b"L\r", b"\r"),
        (b"t1231FF\r", b"\a"),  # listen-only mode
        (b"C\r", b"\r"),
        (b"O\r", b"\r"),
        (b"O\r", b"\a"),
        (b"S8\r", b"\a"),
        (b"Z1\r", b"\a"),
        (b"t12\r", b"\a"),
        (b"t1231FF\r", b"z\rt1231FF\r"),
        (b"T000001231FF\r", b"Z\rT000001231FF\r"),
        (b"r1238\r", b"z\rr1238\r"),
        (b"b123900112233445566778899AABB\r", b"z\rb123900112233445566778899AABB\r"),
    ]:
        serial_exchange(echo.link, line, reply)


def test_after_a_stop_the_newest_scans_come_and_the_missed_ones_are_counted(
    sensor: Sensor, link: Path, clock: PacedClock
) -> None:
    """Board, adapter and driver stand still for a minute, as one suspended process."""
    firmware = firmware_for(sensor, True, clock)
    adapter = EmulatedAdapter(link, firmware, clock)
    adapter.open()
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    try:
        first = next(read_scans(board, 1)).sequence
        clock.jump(60.0)
        scan = next(read_scans(board, 1))
        while not scan.status & ScanStatus.SCAN_OVERRUN:  # sent before the stop
            assert scan.sequence < 1_000
            scan = next(read_scans(board, 1))
        assert clock.wall() - scan.stamp < 1e9
        losses = board.decoder.statistics
        assert firmware.missed == losses.lost_scans == scan.sequence - first + 1 - board.decoder.scans > 59_000
        assert all(not scan.status for scan in read_scans(board, 100))
        assert (losses.lost_scans, losses.incomplete_scans, adapter.frames_dropped) == (firmware.missed, 0, 0)
        assert board.report().fault_counts[FaultKind.LOST_SCANS] == losses.lost_scans
    finally:
        board.close()
        adapter.close()


def test_a_terminal_that_is_not_read_loses_whole_scans_beyond_half_a_second(sensor: Sensor, link: Path) -> None:
    clock = PacedClock(main=False)
    firmware = firmware_for(sensor, False, clock)
    adapter = EmulatedAdapter(link, firmware, clock)
    adapter.open()
    try:
        with slcan_opener(link, False)() as bus:
            base = sensor.can.base_id
            bus.write_frame((base + COMMAND_OFFSET, CLASSIC, Request(Command.START, 1).pack()))
            end = SystemClock().monotonic() + PATIENCE * 1e9
            parts = []
            for dropped in (1000, 3000):
                while adapter.frames_dropped < dropped:
                    assert SystemClock().monotonic() < end
                    SystemClock().sleep(0.01)  # not jumps, which turn the board's clock over on a fast machine
                parts.append(len(adapter._waiting))
            assert parts[0] == parts[1], "memory grows while nobody reads"
            waiting = adapter.frames_sent
            decoder = Decoder(with_fd(sensor, False))
            decoder.start()
            while decoder.statistics.lost_scans == 0:
                assert SystemClock().monotonic() < end
                list(decoder.decode(bus.read_frames(0.1), 0, 0))
            assert decoder.statistics.incomplete_scans == 0
            assert waiting < 6 * 1.2 * sensor.can.scan_rate
            flags = 0
            while not flags & 1:  # a reply for which there is no room is lost
                assert SystemClock().monotonic() < end
                bus.ask_state()
                flags = next((frame[2][1] for frame in bus.read_frames(0.1) if frame[1] & ERROR), 0)
    finally:
        adapter.close()


def test_a_delayed_adapter_loses_no_frames(sensor: Sensor, link: Path, clock: PacedClock) -> None:
    adapter = EmulatedAdapter(link, firmware_for(sensor, True, clock), clock)
    adapter.open()
    board = Board(sensor, slcan_opener(link), clock)
    board.open()
    try:
        list(read_scans(board, 10))
        clock.jump(0.4)
        for scan in read_scans(board, 600):
            assert_marked(scan)
        assert scan.frames_lost == 0
        assert adapter.frames_dropped == 0
    finally:
        board.close()
        adapter.close()


class Recorder(Echo):
    """Records the calls."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int]] = []

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        self.asked.append(("due", now))
        return []

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        self.asked.append(("receive", now))
        return [frame]


def test_due_frames_are_sent_before_the_response_to_a_later_command(link: Path, clock: PacedClock) -> None:
    """As on a board, whose response gives the sequence after the scans already sent."""
    node = Recorder()
    adapter = EmulatedAdapter(link, node, clock)
    adapter.open()
    try:
        serial_exchange(link, b"O\rt1231FF\r", b"\rz\rt1231FF\r")
    finally:
        adapter.close()
    [(index, now)] = [(index, now) for index, (what, now) in enumerate(node.asked) if what == "receive"]
    assert node.asked[index - 1] == ("due", now)


def test_an_adapter_does_not_overwrite_a_file(tmp_path: Path) -> None:
    path = tmp_path / "precious"
    path.write_text("mine")
    with pytest.raises(SourceError, match="precious: the adapter cannot be linked here: there is something else"):
        EmulatedAdapter(path, Echo()).open()
    assert path.read_text() == "mine"


def test_a_port_can_be_opened_by_only_one_driver(echo: EmulatedAdapter) -> None:
    with (
        SlcanBus(str(echo.link), bitrate=1_000_000),
        pytest.raises(can.CanInitializationError, match="in use by another process"),
    ):
        SlcanBus(str(echo.link), bitrate=1_000_000)


def test_opening_errors_give_the_reason(tmp_path: Path) -> None:
    with pytest.raises(can.CanInitializationError, match="none: No such file or directory"):
        SlcanBus(str(tmp_path / "none"))
    plain = tmp_path / "plain"
    plain.touch()
    with pytest.raises(can.CanInitializationError, match="plain: not a serial port: Inappropriate ioctl"):
        SlcanBus(str(plain))
    with pytest.raises(ValueError, match=r"bitrate must be one of 10000, .* with slcan, got 123"):
        SlcanBus(str(plain), bitrate=123)
    with pytest.raises(ValueError, match="data_bitrate must be one of 2000000, 5000000 with slcan, got 4000000"):
        SlcanBus(str(plain), bitrate=500_000, data_bitrate=4_000_000, fd=True)


def test_a_thousand_reopenings_of_the_port_leave_no_descriptor_and_no_thread(sensor: Sensor, link: Path) -> None:
    adapter = EmulatedAdapter(link, firmware_for(sensor, True, SystemClock()))
    adapter.open()
    try:
        bus = ReconnectingBus(slcan_opener(link), None, SystemClock())
        gc.collect()  # of what other tests left
        descriptors, threads = len(os.listdir("/proc/self/fd")), threading.active_count()
        for _ in range(1000):
            bus.connect()
            bus.fail()
        # What other tests left may go meanwhile.
        assert len(os.listdir("/proc/self/fd")) <= descriptors
        assert threading.active_count() <= threads
        assert bus.opened == 1000
    finally:
        adapter.close()
