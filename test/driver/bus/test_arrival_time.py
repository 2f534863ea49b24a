# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The time of arrival from the kernel's stamps: never outside the read, and not across a step of the wall clock."""

from __future__ import annotations

from pathlib import Path

import pytest

from posfet_core.protocol import OFFSET_TOLERANCE, ArrivalTime
from posfet_driver.board.board_client import Board
from posfet_driver.board.listening_board import ListeningBoard
from posfet_driver.bus.frame import Frame
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.bus_node import Node
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import SteppedClock
from support.fake_board import FakeBoard, read_scans, with_layout
from support.own_boards import BoardB, Transmitter, millivolts_of, sensor_b

MILLISECOND = 1_000_000
OFFSET = 1_700_000_000_000_000_000


@pytest.fixture
def arrival() -> ArrivalTime:
    """After a read at 100 ms."""
    arrival = ArrivalTime()
    assert arrival.of_newest(0, 100 * MILLISECOND, OFFSET) == 100 * MILLISECOND
    return arrival


@pytest.mark.parametrize(
    ("stamped", "expected"),
    [(103, 103), (110, 110), (99, 100), (-50_000, 100), (111, 110), (50_000, 110)],
    ids=["between", "now", "before the previous read", "long before", "after this read", "long after"],
)
def test_the_frame_arrived_between_the_reads(arrival: ArrivalTime, stamped: int, expected: int) -> None:
    found = arrival.of_newest(OFFSET + stamped * MILLISECOND, 110 * MILLISECOND, OFFSET)
    assert found == expected * MILLISECOND


def test_without_a_stamp_it_is_the_time_of_the_read(arrival: ArrivalTime) -> None:
    assert arrival.of_newest(0, 110 * MILLISECOND, OFFSET) == 110 * MILLISECOND


def test_the_first_read_has_no_offset_to_compare_with() -> None:
    assert ArrivalTime().of_newest(OFFSET + MILLISECOND, 2 * MILLISECOND, OFFSET) == 2 * MILLISECOND


@pytest.mark.parametrize("step", [-3_600_000_000_000, -2 * OFFSET_TOLERANCE, 2 * OFFSET_TOLERANCE, 3_600_000_000_000])
def test_a_wall_clock_that_is_set_between_arrival_and_read_does_not_matter(arrival: ArrivalTime, step: int) -> None:
    stamp = OFFSET + 103 * MILLISECOND
    assert arrival.of_newest(stamp, 110 * MILLISECOND, OFFSET + step) == 110 * MILLISECOND
    assert arrival.of_newest(stamp + step + 10 * MILLISECOND, 120 * MILLISECOND, OFFSET + step) == 113 * MILLISECOND


def test_a_delay_between_the_readings_of_the_clocks_never_makes_it_early(arrival: ArrivalTime) -> None:
    late = OFFSET + OFFSET_TOLERANCE // 2
    assert arrival.of_newest(OFFSET + 103 * MILLISECOND, 110 * MILLISECOND, late) == 103 * MILLISECOND


class LateBus:
    """A bus whose reader is woken `delay` [ns] after the newest frame has arrived."""

    unreadable = 0
    arrival_stamp = 0
    must_be_asked = False
    port, read_by_port = None, False

    def __init__(self, clock: SteppedClock, firmware: Node, delay: int, stamped: bool) -> None:
        self._clock, self._firmware, self._delay, self._stamped = clock, firmware, delay, stamped
        self._answers: list[Frame] = []

    def read_frames(self, timeout: float) -> list[Frame]:
        arrival = max(self._clock.now, min(self._firmware.next_due(), self._clock.now + round(timeout * 1e9)))
        frames = self._answers + self._firmware.due(arrival)
        self.arrival_stamp = OFFSET + arrival if self._stamped and frames else 0
        self._clock.now = arrival + self._delay
        self._answers = []
        return frames

    def write_frame(self, frame: Frame) -> None:
        self._answers += self._firmware.receive(frame, self._clock.now)

    def ask_state(self) -> None: ...

    def shutdown(self) -> None: ...


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
@pytest.mark.parametrize("stamped", [True, False])
def test_stamps_of_scans_do_not_depend_on_when_a_busy_process_reads_them(stamped: bool, fd: bool) -> None:
    sensor = with_layout(load_sensor(), 5, 5, scan_rate=1000.0, fd=fd)
    clock = SteppedClock(now=1_000 * MILLISECOND, epoch=OFFSET)
    firmware = BoardFirmware(sensor, FakeBoard(sensor), clock.now)
    bus = LateBus(clock, firmware, 40 * MILLISECOND, stamped)
    board = Board(sensor, lambda: bus, clock)
    board.open()
    delays = [
        scan.stamp - OFFSET - firmware.switched_on - scan.sequence * MILLISECOND for scan in read_scans(board, 200)
    ]
    # Of the scans that are waiting at each read, only the newest has just arrived.
    assert min(delays) >= 0
    assert (max(delays[50:]) < MILLISECOND) == stamped


@pytest.mark.parametrize("stamped", [True, False])
def test_a_board_with_frames_of_its_own_has_these_stamps_too(tmp_path: Path, stamped: bool) -> None:
    clock = SteppedClock(now=1_000 * MILLISECOND, epoch=OFFSET)
    style = BoardB()
    transmitter = Transmitter(lambda index: style.scan(index, millivolts_of(index)), begin := clock.now)
    board = ListeningBoard(sensor_b(tmp_path), lambda: LateBus(clock, transmitter, 40 * MILLISECOND, stamped), clock)
    board.open()
    delays = [scan.stamp - OFFSET - begin - scan.sequence * MILLISECOND for scan in read_scans(board, 200)]
    assert min(delays) >= 0
    assert (max(delays[50:]) < MILLISECOND) == stamped
