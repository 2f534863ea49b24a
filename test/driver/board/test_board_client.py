# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The board client: end to end over the virtual bus of python-can, and on buses that fail."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from itertools import pairwise

import can
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.frame_timing import classic_time, fd_time
from posfet_driver.bus.open_bus import bus_settings, open_bus
from posfet_driver.bus.reconnecting_bus import BACK_OFF_LAST
from posfet_driver.protocol.messages import RESPONSE_OFFSET, Command, Response, Result
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import ScanStatus
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import PacedClock, SteppedClock
from support.fake_board import FakeBoard, assert_marked, board_on_bus, read_scans, read_until, with_fd, with_layout
from support.long_cases import crossed, long_cases
from support.stepped import SteppedBus


@pytest.fixture
def channel() -> str:
    return uuid.uuid4().hex


@pytest.fixture
def virtual(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as bus:
        yield bus


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_scans_over_a_virtual_bus(sensor: Sensor, virtual: can.BusABC, channel: str, fd: bool) -> None:
    sensor = with_layout(sensor, 5, 5, scan_rate=200.0)
    settings = bus_settings("virtual", channel, with_fd(sensor, fd).can, options=["receive_own_messages=False"])
    clock = PacedClock()
    board = Board(with_fd(sensor, fd), lambda: open_bus(settings), clock)
    firmware = BoardFirmware(with_fd(sensor, fd), FakeBoard(sensor), clock.monotonic())
    with board_on_bus(virtual, firmware, clock):
        board.open()
        try:
            sequences = []
            for scan in read_scans(board, 100):
                assert_marked(scan)
                sequences.append(scan.sequence)
            assert sequences == list(range(sequences[0], sequences[0] + 100))
            assert board.report().health == Health.OK
            assert board.report().frames_lost == 0
        finally:
            board.close()


@pytest.mark.parametrize(
    ("fd", "kind", "occupied"),
    [
        (True, FD | RATE_SWITCH, fd_time(64, 1e6, 5e6).most),
        (True, FD, fd_time(64, 1e6, 1e6).most),
        (False, CLASSIC, 6 * classic_time(8, 1e6).most),  # five blocks and a header
    ],
    ids=["with rate switch", "without rate switch", "classic"],
)
def test_the_bound_of_a_stamp_allows_for_the_frames_that_came(
    sensor: Sensor, fd: bool, kind: int, occupied: float
) -> None:
    clock, sensor = SteppedClock(), with_fd(sensor, fd)
    firmware = BoardFirmware(sensor, FakeBoard(sensor), 0)
    due = firmware.due

    def sent(now: int, until: int | None = None) -> list[Frame]:
        return [(identifier, kind if len(data) == 64 else CLASSIC, data) for identifier, _, data in due(now, until)]

    firmware.due = sent  # type: ignore[method-assign]
    board = Board(sensor, lambda: SteppedBus(clock, firmware), clock=clock)
    board.open()
    *_, scan = read_scans(board, 100)
    assert occupied <= scan.stamp_uncertainty < occupied + 50e-6


def test_two_boards_share_a_bus(sensor: Sensor, virtual: can.BusABC, channel: str) -> None:
    sensors = [with_layout(sensor, 5, 5, scan_rate=100.0, base_id=base) for base in (0x100, 0x110)]
    boards, clock = [], PacedClock()
    with can.Bus(interface="virtual", channel=channel) as second:
        firmwares = [BoardFirmware(s, FakeBoard(s), clock.monotonic()) for s in sensors]
        with board_on_bus(virtual, firmwares[0], clock), board_on_bus(second, firmwares[1], clock):
            for one in sensors:
                settings = bus_settings("virtual", channel, one.can)
                boards.append(Board(one, lambda settings=settings: open_bus(settings), clock))
            try:
                for board in boards:
                    board.open()
                    read_until(board, lambda board=board: board.report().scans > 0)
                for board in boards:
                    for scan in read_scans(board, 20):
                        assert_marked(scan)
                    assert board.report().frames_lost == 0
                    assert board.report().counters["unrelated frames"] > 0
            finally:
                for board in boards:
                    board.close()


def attempts_to_open(sensor: Sensor, duration: float, count: int) -> tuple[list[float], Board]:
    """Return the pauses between attempts to open an adapter [s], each of which takes `duration` [s] and fails."""
    clock = SteppedClock()
    attempts: list[tuple[int, int]] = []

    def fail() -> FrameBus:
        begin = clock.now
        clock.now += round(duration * 1e9)
        attempts.append((begin, clock.now))
        raise can.CanInitializationError("no such\ndevice")

    board = Board(sensor, fail, clock=clock)
    board.open()
    while len(attempts) < count:
        assert board.read(1.0) is None
    return [(begin - end) / 1e9 for (_, end), (begin, _) in pairwise(attempts[:count])], board


def test_pauses_between_attempts_to_open_grow_from_100_to_250_ms(sensor: Sensor) -> None:
    pauses, board = attempts_to_open(sensor, 0.0, 10)
    assert pauses == pytest.approx([0.1, 0.2, *[BACK_OFF_LAST] * 7], abs=1e-6)
    assert BACK_OFF_LAST == 0.25
    assert board.report().health == Health.ERROR
    assert board.report().state == "CAN bus unavailable, retrying: no such device"


@pytest.mark.parametrize(("duration", "pause"), [(0.06, 0.25), (0.2, 0.8), (1.0, 4.0), (3.0, 5.0)])
def test_an_adapter_that_takes_long_to_open_is_opened_less_often(sensor: Sensor, duration: float, pause: float) -> None:
    pauses, _ = attempts_to_open(sensor, duration, 6)
    assert pauses[2:] == pytest.approx([pause] * 3, abs=1e-6)


def test_an_adapter_that_took_long_to_open_and_has_worked_is_opened_again_after_100_ms(sensor: Sensor) -> None:
    clock = SteppedClock()
    firmware = BoardFirmware(sensor, FakeBoard(sensor), 0)
    buses: list[SteppedBus] = []
    begins: list[int] = []

    def open_one() -> SteppedBus:
        begins.append(clock.now)
        clock.now += 1_000_000_000
        buses.append(SteppedBus(clock, firmware))
        return buses[-1]

    board = Board(sensor, open_one, clock=clock)
    board.open()
    next(read_scans(board, 1))
    buses[-1].broken = True
    lost = clock.now
    next(read_scans(board, 1))
    assert begins[1] - lost == pytest.approx(0.1e9, abs=1e6)


def test_data_flows_within_half_a_second_after_the_bus_returns(sensor: Sensor) -> None:
    clock = SteppedClock()
    buses: list[SteppedBus] = []
    firmware = BoardFirmware(sensor, FakeBoard(sensor), 0)

    def open_one() -> SteppedBus:
        buses.append(SteppedBus(clock, firmware))
        return buses[-1]

    board = Board(sensor, open_one, clock=clock)
    board.open()
    for fault in range(5):
        for scan in read_scans(board, 50):
            assert_marked(scan)
        buses[-1].broken = True
        back = clock.now
        scan = next(read_scans(board, 1))
        assert_marked(scan)
        assert clock.now - back < 500_000_000
        assert len(buses) == fault + 2
        assert buses[-2].closed
    losses = board.decoder.statistics
    assert board.decoder.scans + losses.lost_scans + losses.incomplete_scans == scan.sequence + 1
    assert board.report().counters["bus reopened"] == 5
    board.close()
    assert buses[-1].closed
    assert not firmware.running


def reopened(sensor: Sensor) -> tuple[Board, list[SteppedBus]]:
    """Return an open board with the buses to it, of which there is one each time that it is opened."""
    clock, firmware = SteppedClock(), BoardFirmware(sensor, FakeBoard(sensor), 0)
    buses: list[SteppedBus] = []

    def open_one() -> SteppedBus:
        buses.append(SteppedBus(clock, firmware))
        return buses[-1]

    board = Board(sensor, open_one, clock=clock)
    board.open()
    return board, buses


def cable_out() -> None:
    raise can.CanOperationError("cable out")


def test_an_adapter_that_fails_while_it_is_asked_why_no_scans_arrive_is_opened_again(sensor: Sensor) -> None:
    board, buses = reopened(sensor)
    list(read_scans(board, 50))
    buses[0].ask_state = cable_out  # type: ignore[method-assign]
    buses[0].held_back = True
    for scan in read_scans(board, 50):
        assert_marked(scan)
    assert len(buses) == 2
    assert board.report().counters["bus losses"] == 1


@pytest.mark.parametrize("must_be_asked", [True, False])
def test_only_an_adapter_that_must_be_asked_is_asked_while_scans_flow_once_a_second(
    sensor: Sensor, must_be_asked: bool
) -> None:
    clock, asked = SteppedClock(), list[int]()
    bus = SteppedBus(clock, BoardFirmware(sensor, FakeBoard(sensor), 0))
    bus.must_be_asked = must_be_asked
    bus.ask_state = lambda: asked.append(clock.now)  # type: ignore[method-assign]
    board = Board(sensor, lambda: bus, clock=clock)
    board.open()
    first = next(read_scans(board, 1)).stamp
    while clock.now < first + 5_500_000_000:
        next(read_scans(board, 1))
    assert len(asked) == 6 * must_be_asked
    assert all(later - before == pytest.approx(1e9, abs=1e7) for before, later in pairwise(asked))


def test_an_adapter_that_fails_while_it_is_asked_beside_scans_is_opened_again(sensor: Sensor) -> None:
    board, buses = reopened(sensor)
    next(read_scans(board, 1))
    buses[0].must_be_asked, buses[0].ask_state = True, cable_out  # type: ignore[method-assign]
    for scan in read_scans(board, 2000):
        assert_marked(scan)
    assert len(buses) == 2
    assert board.report().counters["bus losses"] == 1


@pytest.mark.parametrize("boot", [1, 0], ids=["another boot", "the same number drawn"])
def test_a_board_reset_is_detected_and_reported(sensor: Sensor, boot: int) -> None:
    clock = SteppedClock()
    bus = SteppedBus(clock, BoardFirmware(sensor, FakeBoard(sensor), 0))
    board = Board(sensor, lambda: bus, clock=clock)
    board.open()
    list(read_scans(board, 1000))
    bus.firmware = BoardFirmware(sensor, FakeBoard(sensor), clock.now, boot)
    scan = next(read_scans(board, 1))
    assert_marked(scan)
    assert scan.sequence < 1000
    assert scan.status & ScanStatus.BOARD_RESET
    assert abs(scan.stamp - clock.now) < 2_000_000
    assert not next(read_scans(board, 1)).status & ScanStatus.BOARD_RESET
    report = board.report()
    resets, brown_outs = (report.fault_counts[kind] for kind in (FaultKind.BOARD_RESETS, FaultKind.BROWN_OUTS))
    assert (resets, brown_outs, report.counters["board restarts"]) == (1, 0, 1 - boot)


def test_a_board_that_sends_only_incomplete_scans_is_not_reported_healthy(sensor: Sensor) -> None:
    clock = SteppedClock()
    larger = with_layout(sensor, 8, 8)  # expects three blocks per scan, the board sends one
    bus = SteppedBus(clock, BoardFirmware(sensor, FakeBoard(sensor), 0))
    board = Board(larger, lambda: bus, clock=clock)
    board.open()
    while board.restarted < 5:
        assert board.read(0.05) is None
        assert board.report().health != Health.OK
    assert board.report().state == "the board sends no complete scans: restarting it"
    assert board.report().fault_counts[FaultKind.INCOMPLETE_SCANS] > 1000


def test_a_delayed_reader_loses_no_scans(sensor: Sensor) -> None:
    clock = SteppedClock()
    bus = SteppedBus(clock, BoardFirmware(with_fd(sensor, False), FakeBoard(sensor), 0))
    board = Board(with_fd(sensor, False), lambda: bus, clock=clock)
    board.open()
    list(read_scans(board, 10))
    clock.now += 2_000_000_000
    for scan in read_scans(board, 3000):
        assert_marked(scan)
    assert scan.frames_lost == 0
    assert board.restarted == 0


@pytest.mark.parametrize(
    ("length", "held_up", "fd"),
    long_cases(
        crossed([0.1, 0.6, 1.0], ["host", "adapter"], {"fd": True, "classic": False}),
        ["0.1-adapter-classic", "1.0-host-fd"],
    ),
)
def test_a_pause_without_frame_loss_loses_no_scans(sensor: Sensor, length: float, held_up: str, fd: bool) -> None:
    """At any time, also while frames are held until their sequence is certain; afterwards in limited batches."""
    for first in (3, 17, 40, 41, 57):
        clock = SteppedClock()
        bus = SteppedBus(clock, BoardFirmware(with_fd(sensor, fd), FakeBoard(sensor), 0))
        bus.room = 30
        board = Board(with_fd(sensor, fd), lambda bus=bus: bus, clock=clock)
        board.open()
        list(read_scans(board, first))
        for scans in (500, 300, 2100):
            if held_up == "host":
                clock.now += round(length * 1e9)
            else:
                bus.stands_until = clock.now + round(length * 1e9)
            for scan in read_scans(board, scans):
                assert_marked(scan)
        assert scan.frames_lost == 0
        assert board.decoder.scans == scan.sequence + 1


def test_querying_the_board_after_a_pause_loses_no_scans(sensor: Sensor) -> None:
    clock = SteppedClock()
    bus = SteppedBus(clock, BoardFirmware(sensor, FakeBoard(sensor), 0))
    board = Board(sensor, lambda: bus, clock=clock)
    board.open()
    list(read_scans(board, 10))
    bus.held_back = True
    while board.restarted == 0:
        assert board.read(0.05) is None
    bus.held_back = False
    for scan in read_scans(board, 1000):
        assert_marked(scan)
    assert scan.frames_lost == 0
    assert board.report().health == Health.OK


def test_a_response_to_another_client_is_ignored(sensor: Sensor) -> None:
    clock = SteppedClock()
    bus = SteppedBus(clock, BoardFirmware(sensor, FakeBoard(sensor), 0))
    response = Response(Command.IDENTIFY, tag=200, result=Result.OK, value=7)
    bus.firmware.receive = lambda frame, now: [(sensor.can.base_id + RESPONSE_OFFSET, CLASSIC, response.pack())]
    board = Board(sensor, lambda: bus, clock=clock)
    board.open()
    assert board.read(0.1) is None
    assert board.report().state == "looking for the board"


def test_reading_a_closed_board_returns_none(sensor: Sensor) -> None:
    clock = SteppedClock()
    board = Board(sensor, lambda: pytest.fail("opened"), clock=clock)
    assert board.read(0.5) is None
    assert clock.now == 500_000_000
    assert board.report().health == Health.STALE
    board.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"interface": "slcam"}, r"CAN interface must be one of .*slcan, .*socketcan.*virtual.*, got 'slcam'"),
        ({"options": ["bitrat=1"]}, r"interface 'virtual' has no option 'bitrat', known are .*preserve_timestamps"),
        ({"options": ["loud"]}, r"CAN option must be 'key=value', got 'loud'"),
    ],
)
def test_invalid_bus_parameters_are_rejected_with_the_reason(
    sensor: Sensor, arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        bus_settings(**{"interface": "virtual", "channel": "", "link": sensor.can} | arguments)
    assert "\n" not in str(caught.value)


def test_bus_parameters_default_to_those_of_the_sensor(sensor: Sensor) -> None:
    plain = bus_settings("slcan", "x", sensor.can)
    assert (plain.bitrate, plain.data_bitrate, plain.fd) == (1_000_000, 5_000_000, True)
    given = bus_settings("slcan", "x", sensor.can, bitrate=500_000, data_bitrate=2_000_000)
    assert (given.bitrate, given.data_bitrate, given.fd) == (500_000, 2_000_000, True)
    options = bus_settings("virtual", "x", sensor.can, options=["", "rx_queue_size=7", "preserve_timestamps=true"])
    assert options.options == {"rx_queue_size": 7, "preserve_timestamps": True}


def test_a_bus_that_cannot_be_opened_reports_the_reason(sensor: Sensor) -> None:
    with pytest.raises(can.CanError, match="slcan:/nowhere/can: No such file") as caught:
        open_bus(bus_settings("slcan", "/nowhere/can", sensor.can))
    assert isinstance(caught.value.__cause__, can.CanInitializationError)
    with pytest.raises(ConfigError, match="slcan:x: bitrate must be one of"):
        open_bus(bus_settings("slcan", "x", sensor.can, bitrate=123))
    with pytest.raises(can.CanError, match="socketcan:nosuchcan0: ") as caught:
        open_bus(bus_settings("socketcan", "nosuchcan0", sensor.can))
    assert "\n" not in str(caught.value)
