# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The reference firmware keeps every rule of the protocol, whatever is free; in virtual time."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from posfet_driver.bus.frame import Frame
from posfet_driver.conformance.records import Board
from posfet_driver.conformance.session import Session
from posfet_driver.conformance.timer_checks import missing_scans
from support.clocks import SteppedClock
from support.conforming import failed, findings_of, not_applicable, unchecked
from support.reference_board import VirtualBoard, virtual_board
from support.stepped import SteppedBus

STEP = 1_000_000
"""Time after which frames of the board are collected [ns]."""
SEEDS = range(8)


class FirmwareNode:
    """The firmware as a board on a stepped bus, whose time began at `now` [ns]."""

    def __init__(self, board: VirtualBoard, boot: int, now: int) -> None:
        self._board, self._boot = board, boot
        self._begin = self._read = self._on = now
        self._first: list[Frame] = []

    def next_due(self) -> int:
        return max(self._read + STEP, self._on)

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        if now < self._on:
            return []
        self._read = now
        frames, self._first = self._first + self._board.run_until(self._time(now)), []
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        return self._board.send(frame) if now >= self._on else []

    def switch_on(self, now: int) -> None:
        self._boot = (self._boot + 1) % 16
        self._board.run_until(self._time(now))
        self._first, self._on = self._board.line(f"R {self._boot}"), now

    def stall(self, now: int) -> None:
        """Let the processor of the board stand still until `now` [ns]."""
        self._first, self._on = self._board.line(f"J {self._time(now)}"), now  # what it is sent meanwhile is lost

    def _time(self, now: int) -> int:
        return (now - self._begin) // 1000


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize("seed", SEEDS)
def test_the_firmware_conforms_whatever_is_free(program: Path, stack: ExitStack, seed: int) -> None:
    numbers = random.Random(seed)
    fd, boot = seed % 2 == 0, numbers.randrange(16)
    rows, columns = numbers.choice(((1, 1), (5, 5), (2, 13), (8, 8) if fd else (3, 5)))
    period = numbers.choice((4_000, 8_500, 12_345, 20_000))
    board = Board(numbers.randrange(0x700), rows * columns, numbers.randrange(1, 0x1_0000), fd, period, fd_bus=True)
    options = {
        "--format": "fd" if fd else "classic",
        "--layout": f"{rows}x{columns}",
        "--layout-id": board.layout,
        "--base-id": board.base,
        "--boot": boot,
        "--period": period,
        "--period-step": numbers.choice([step for step in (1, 5, 10, 500) if period % step == 0]),
    }
    flags = [flag for flag in ("--no-rate-switch", "--tests-beside") if numbers.random() < 0.5]
    words = [str(word) for option in options.items() for word in option]

    def make(now: int) -> FirmwareNode:
        return FirmwareNode(stack.enter_context(virtual_board(program, *words, *flags)), boot, now)

    findings, _ = findings_of(board, make, power_cycle=True, seed=seed)
    assert failed(findings) == {}, (board, options, flags)
    assert unchecked(findings) == not_applicable(board)


def test_scans_that_the_firmware_misses_are_flagged(program: Path, stack: ExitStack) -> None:
    clock = SteppedClock(1_000_000_000)
    node = FirmwareNode(stack.enter_context(virtual_board(program, "--period", "20000")), 0, clock.now)
    session = Session(SteppedBus(clock, node), clock, Board(0x100, 25, 1, True, 20_000, True), random.Random(1))
    session.find()
    with session.scanning():
        session.listen_to_scans(10)
        node.stall(clock.now + 250_000_000)
        session.listen_to_scans(40)
    assert missing_scans(session).endswith("scans missing, flagged")
