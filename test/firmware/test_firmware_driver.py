# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver on the reference firmware behind a pseudo-terminal: nothing of the board is shared with the driver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.protocol.messages import Command
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from support.fake_board import PATIENCE, read_scans, read_until, slcan_opener, with_fd, with_layout
from support.reference_board import TerminalBoard, terminal_board

RATE = 250.0
"""Scan rate that the driver sets [Hz]; after power-on the board has 1 kHz."""
PERIOD = round(1e6 / RATE)


@dataclass(frozen=True)
class Bench:
    """The board, its driver, and the scans that the board has sampled."""

    hardware: TerminalBoard
    board: Board
    sensor: Sensor
    log: Path

    def sampled(self, boot: int) -> dict[int, tuple[int, list[int]]]:
        """Return time [us] and counts of each sequence in a boot."""
        lines = self.log.read_text().split("\n")[:-1]  # the last one may be incomplete
        rows = [[int(word) for word in line.split()] for line in lines]
        return {row[1]: (row[2], row[3:]) for row in rows if row[0] == boot}

    def assert_as_sampled(self, scans: list[Scan], boot: int) -> None:
        """Compare scans with what the board has sampled: sequence, time and counts."""
        sampled = self.sampled(boot)
        for scan in scans:
            time, counts = sampled[scan.sequence]
            sent = np.array(counts)
            if not self.sensor.can.fd:  # the 12 high bits
                sent = sent >> 4 << 4 | sent >> 12
            np.testing.assert_array_equal(scan.counts, sent)
            assert scan.device_time == time == self.time_of(scan.sequence, sampled)

    @staticmethod
    def time_of(sequence: int, sampled: dict[int, tuple[int, list[int]]]) -> int:
        """Return the time of a sequence by whole periods from the first one that was sampled at the set rate."""
        first = min(sampled)
        return sampled[first][0] + (sequence - first) * PERIOD

    def missed(self, boot: int) -> int:
        """Return how many ticks the board has missed or was stopped at: it misses some on a busy machine."""
        sampled = self.sampled(boot)
        return max(sampled) - min(sampled) + 1 - len(sampled)

    def assert_all_published(self, scans: list[Scan], boot: int) -> None:
        """Assert that consecutive scans are all that the board has sampled meanwhile."""
        first, last = scans[0].sequence, scans[-1].sequence
        assert [scan.sequence for scan in scans] == [each for each in self.sampled(boot) if first <= each <= last]
        losses = self.board.decoder.statistics
        assert losses.lost_scans <= self.missed(boot)
        assert (losses.incomplete_scans, losses.malformed, losses.checksum, losses.late) == (0, 0, 0, 0)

    def read(self, count: int) -> list[Scan]:
        return [replace(scan, counts=scan.counts.copy()) for scan in read_scans(self.board, count)]

    def request(self, command: Command, argument: int = 0) -> int:
        return self.board.request(command, argument, timeout=PATIENCE).value


@pytest.fixture(params=["fd", "classic", "fd 16x16", "classic 16x16"])
def bench(request: pytest.FixtureRequest, program: Path, tmp_path: Path) -> Iterator[Bench]:
    form, _, size = request.param.partition(" ")
    rows, cols = (16, 16) if size else (5, 5)
    sensor = with_fd(with_layout(load_sensor(), rows, cols, scan_rate=RATE), form == "fd")
    log = tmp_path / "scans.txt"
    options = ["--format", form, "--layout", f"{rows}x{cols}", "--log", str(log), "--boot", "14"]
    with terminal_board(program, *options) as hardware:
        board = Board(sensor, slcan_opener(hardware.port, sensor.can.fd))
        board.open()
        try:
            yield Bench(hardware, board, sensor, log)
        finally:
            board.close()


def test_scans_are_received_as_they_were_sampled(bench: Bench) -> None:
    scans = bench.read(100)
    bench.assert_all_published(scans, boot=14)
    bench.assert_as_sampled(scans, boot=14)
    flags = {scan.status for scan in scans}
    assert flags <= ({ScanStatus.OK, ScanStatus.SCAN_OVERRUN} if bench.missed(14) else {ScanStatus.OK})
    assert scans[-1].temperatures.tolist() == [25.0, 25.0]
    read_until(bench.board, lambda: bench.board.report().health == Health.OK)


def test_it_stops_and_goes_on_with_the_sequence_of_its_timer(bench: Bench) -> None:
    before = bench.read(20)
    stopped = bench.request(Command.STOP)
    assert stopped > before[-1].sequence
    assert bench.board.read(0.05) is None
    started = bench.request(Command.START)
    after = bench.read(20)
    assert started >= stopped
    assert after[0].sequence >= started
    bench.assert_all_published(after, boot=14)
    bench.assert_as_sampled(before + after, boot=14)


def test_it_answers_what_it_is_and_tests_itself(bench: Bench) -> None:
    bench.read(1)
    assert bench.request(Command.IDENTIFY) == 0x0102_0001 | bench.sensor.can.fd << 20
    with pytest.raises(CommandError, match=r"SELF_TEST.*busy"):
        bench.request(Command.SELF_TEST)
    bench.request(Command.STOP)
    assert bench.request(Command.SELF_TEST) == 0


def test_a_period_that_it_cannot_keep_is_refused(bench: Bench) -> None:
    bench.read(1)
    with pytest.raises(CommandError, match=r"SET_RATE.*bad argument"):
        bench.request(Command.SET_RATE, 999)
    scans = bench.read(20)
    bench.assert_as_sampled(scans, boot=14)


def test_a_new_period_holds_from_the_next_scan_on(bench: Bench) -> None:
    bench.read(20)
    assert bench.request(Command.SET_RATE, 8000) == 8000
    scans = bench.read(40)[-20:]  # those that were on the way are past
    sampled = bench.sampled(14)
    assert {b.device_time - a.device_time for a, b in pairwise(scans)} == {8000}
    assert {b.sequence - a.sequence for a, b in pairwise(scans)} == {1}
    assert [scan.device_time for scan in scans] == [sampled[scan.sequence][0] for scan in scans]


def test_after_a_power_cycle_it_is_started_again(bench: Bench) -> None:
    before = bench.read(50)
    for boot in (15, 0):  # the number wraps
        bench.hardware.power_cycle()
        after: list[Scan] = []
        while not (after and after[0].status & ScanStatus.BOARD_RESET):
            after = bench.read(1)
        after += bench.read(30)
        assert not any(scan.status & ScanStatus.BOARD_RESET for scan in after[1:])
        assert [scan.sequence for scan in after] == [*range(after[0].sequence, after[0].sequence + 31)]
        bench.assert_as_sampled(after, boot)
    bench.assert_as_sampled(before, boot=14)
    read_until(bench.board, lambda: bench.board.report().health == Health.OK)


def test_a_board_that_goes_away_and_comes_back_is_found_again(program: Path, tmp_path: Path) -> None:
    link = tmp_path / "board"
    sensor = with_layout(load_sensor(), 5, 5, scan_rate=RATE)
    board = Board(sensor, slcan_opener(link))
    board.open()
    try:
        with terminal_board(program, "--link", str(link), "--boot", "3") as hardware:
            assert hardware.port == str(link)
            list(read_scans(board, 20))
        read_until(board, lambda: board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,))
        with terminal_board(program, "--link", str(link), "--boot", "4"):
            (scan,) = read_scans(board, 1)
            assert scan.status & ScanStatus.BOARD_RESET
            list(read_scans(board, 20))
            read_until(board, lambda: board.report().health == Health.OK)
    finally:
        board.close()
