# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Boards under conformance test in virtual time."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Protocol

from posfet_driver.bus.frame import Frame
from posfet_driver.conformance.checks import Finding, Outcome
from posfet_driver.conformance.conformance import conform
from posfet_driver.conformance.records import Board
from posfet_driver.conformance.session import Session
from support.clocks import SteppedClock
from support.stepped import SteppedBus

SWITCHED_OFF = 1_000_000_000
"""Time for which a board is off in a power cycle [ns]."""


class SwitchedNode(Protocol):
    """A board on a bus in virtual time; what it sends while it is off is lost."""

    def next_due(self) -> int: ...

    def due(self, now: int, until: int | None = None) -> list[Frame]: ...

    def receive(self, frame: Frame, now: int) -> list[Frame]: ...

    def switch_on(self, now: int) -> None:
        """Restart at a time, which may be to come."""


def findings_of(
    board: Board, make: Callable[[int], SwitchedNode], power_cycle: bool = False, seed: int = 1, off: int = SWITCHED_OFF
) -> tuple[dict[str, Finding], Session]:
    """Return the findings on a board, which `make` switches on at a time, and which is off for `off` [ns] if at all."""
    clock = SteppedClock(1_000_000_000)
    node = make(clock.now)
    session = Session(SteppedBus(clock, node), clock, board, random.Random(seed))
    findings = conform(session, (lambda: node.switch_on(clock.now + off)) if power_cycle else None)
    return {finding.rule: finding for finding in findings}, session


def failed(findings: dict[str, Finding]) -> dict[str, str]:
    """Return what was seen of the rules that are broken."""
    return {rule: finding.seen for rule, finding in findings.items() if finding.outcome == Outcome.FAIL}


def unchecked(findings: dict[str, Finding]) -> set[str]:
    """Return the rules that could not be checked."""
    return {rule for rule, finding in findings.items() if finding.outcome == Outcome.NOT_CHECKED}


def not_applicable(board: Board) -> set[str]:
    """Return the rules that cannot be seen on a board of this kind that misses no scan."""
    per_block = 26 if board.fd else 5
    absent = {"S2"} if board.fd else {"S4", "checksum"}
    absent |= {"S4"} if board.blocks == 1 else set()
    absent |= {"S3"} if board.taxels % per_block == 0 else set()
    return absent | {"I5", "T5"}
