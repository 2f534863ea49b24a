# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every rule of the protocol is checked: a board that keeps all rules passes, one that breaks one fails at that one."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from posfet_driver.bus.frame import Frame
from posfet_driver.conformance.checks import CHECKS, NOT_OBSERVABLE, TOPICS, Finding, Outcome
from posfet_driver.conformance.description import load_description
from posfet_driver.conformance.records import Board, NoBoardError
from posfet_driver.conformance.session import Session
from posfet_model.sensor.description import Sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.conforming import failed, findings_of, not_applicable, unchecked
from support.fake_board import FakeBoard, with_layout
from support.long_cases import long_cases
from support.paths import DOCS
from support.protocol_board import Choices, ProtocolBoard
from support.wrong_boards import CLASSIC_BOARDS, FD_BOARDS, POWER_ON_BOARDS, LeavesScansOut, with_bits

DESCRIPTION = load_description()
FD_BOARD = Board(base=0x100, taxels=30, layout=1, fd=True, period=20_000, fd_bus=True)
"""Two blocks, and counts that belong to no taxel; the classic board has three."""
CLASSIC_BOARD = Board(base=0x100, taxels=13, layout=1, fd=False, period=10_000, fd_bus=True)


def run(
    kind: type[ProtocolBoard], board: Board, power_cycle: bool = False, seed: int = 1, free: Choices | None = None
) -> tuple[dict[str, Finding], Session]:
    def make(now: int) -> ProtocolBoard:
        return kind(board.base, board.taxels, board.layout, board.fd, board.period, now - 12_345_678, free)

    return findings_of(board, make, power_cycle, seed)


def test_every_rule_has_a_check_or_a_reason_why_not() -> None:
    checked = {check.rule for check in CHECKS}
    assert checked | set(NOT_OBSERVABLE) == set(DESCRIPTION.rules) | set(TOPICS)
    assert not checked & set(NOT_OBSERVABLE)


def test_every_rule_is_broken_by_a_board() -> None:
    broken = {rule for boards in (FD_BOARDS, CLASSIC_BOARDS, POWER_ON_BOARDS) for rule, _ in boards}
    assert broken == {check.rule for check in CHECKS}


def test_findings_name_their_place_in_the_document() -> None:
    text = (DOCS / "protocol.md").read_text(encoding="utf-8")
    findings, _ = run(ProtocolBoard, FD_BOARD)
    for finding in findings.values():
        document, anchor = finding.place.split("#")
        assert document == "docs/protocol.md"
        headings = {line.lstrip("# ").lower() for line in text.splitlines() if line.startswith("#")}
        assert f'<a id="{anchor}">' in text or anchor in headings


SEEDS = long_cases(range(12), range(4))


def any_board(numbers: random.Random) -> Board:
    fd = numbers.random() < 0.5
    taxels = numbers.choice((1, 5, 25, 26, 27, 64) if fd else (1, 5, 8, 25))
    period = numbers.choice((3_000, 8_000, 12_345, 20_000, 50_000))
    base = numbers.randrange(0x7FF - 8 - 5)
    return Board(base, taxels, numbers.randrange(1, 0x1_0000), fd, period, fd or numbers.random() < 0.5)


def any_choices(numbers: random.Random) -> Choices:
    return Choices(
        first_status=numbers.randrange(100_000),
        first_identity=numbers.randrange(1_000_000),
        identity_restarts=numbers.random() < 0.5,
        response_time=numbers.choice((0, 300, 5_000, 40_000, 180_000)),
        busy_while_scanning=numbers.random() < 0.5,
        period_step=numbers.choice((1, 10, 1000)),
        rate_switch=numbers.random() < 0.5,
        header_at_any_scan=numbers.random() < 0.5,
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_right_board_passes_whatever_is_free(seed: int) -> None:
    numbers = random.Random(seed)
    board, free = any_board(numbers), any_choices(numbers)
    findings, session = run(ProtocolBoard, board, power_cycle=True, seed=seed, free=free)
    assert failed(findings) == {}, (board, free)
    assert unchecked(findings) == not_applicable(board)
    assert not session.scans(len(session.frames) - 3), "the board is stopped at the end"


def ids(boards: list[tuple[str, type[ProtocolBoard]]]) -> list[str]:
    return [f"{rule}-{kind.__name__}" for rule, kind in boards]


@pytest.mark.parametrize(("rule", "kind"), FD_BOARDS, ids=ids(FD_BOARDS))
def test_a_wrong_board_fails_at_its_rule(rule: str, kind: type[ProtocolBoard]) -> None:
    assert set(failed(run(kind, FD_BOARD)[0])) == {rule}


@pytest.mark.parametrize(("rule", "kind"), CLASSIC_BOARDS, ids=ids(CLASSIC_BOARDS))
def test_a_wrong_classic_board_fails_at_its_rule(rule: str, kind: type[ProtocolBoard]) -> None:
    assert set(failed(run(kind, CLASSIC_BOARD)[0])) == {rule}


@pytest.mark.parametrize(("rule", "kind"), POWER_ON_BOARDS, ids=ids(POWER_ON_BOARDS))
def test_what_follows_power_on_is_checked_only_with_a_power_cycle(rule: str, kind: type[ProtocolBoard]) -> None:
    assert set(failed(run(kind, FD_BOARD, power_cycle=True)[0])) == {rule}
    assert failed(run(kind, FD_BOARD)[0]) == {}


class Overrun(ProtocolBoard):
    """It misses 40 scans, 200 ticks after START, and states so if `flagged`."""

    flagged = True
    ticks = 0

    def start(self, argument: int, time: int) -> tuple[int, int]:
        self.ticks = 0
        return super().start(argument, time)

    def late(self) -> bool:
        return self.scanning and 200 <= self.ticks < 240

    def scan(self, sequence: int, tick: int) -> list[Frame]:
        frames = [] if self.late() else super().scan(sequence, tick)
        self.ticks += 1
        return frames

    def flags(self) -> int:
        return 8 if self.flagged and self.scanning and 200 < self.ticks <= 240 else 0

    def status(self) -> list[Frame]:
        return [with_bits(frame, (self.flags() == 8) << 51) for frame in super().status()]


class UnflaggedOverrun(Overrun):
    flagged = False


@pytest.mark.parametrize("board", [FD_BOARD, CLASSIC_BOARD], ids=["fd", "classic"])
def test_missing_scans_must_be_flagged(board: Board) -> None:
    findings, _ = run(Overrun, replace(board, period=5_000))
    assert (findings["T5"].outcome, findings["T5"].seen) == (Outcome.PASS, "40 scans missing, flagged")
    assert failed(findings) == {}
    assert set(failed(run(UnflaggedOverrun, replace(board, period=5_000))[0])) == {"T5"}


def test_classic_scans_that_are_missing_between_two_status_frames_are_not_judged() -> None:
    findings, _ = run(LeavesScansOut, CLASSIC_BOARD)
    assert (findings["T5"].outcome, findings["T5"].seen) == (Outcome.NOT_CHECKED, "no Status at missing scans")


def test_a_bus_without_a_board_is_reported() -> None:
    class Silent(ProtocolBoard):
        def send(self, frame: Frame) -> list[Frame]:
            return []

    with pytest.raises(NoBoardError, match="no Status frame within 1 s at base identifier 0x100"):
        run(Silent, FD_BOARD)


def test_a_board_that_is_not_switched_off_is_reported() -> None:
    class Always(ProtocolBoard):
        def switch_on(self, now: int) -> None:
            if not hasattr(self, "on"):
                super().switch_on(now)

    with pytest.raises(NoBoardError, match="was not switched off and on within 120 s"):
        run(Always, FD_BOARD, power_cycle=True)


class EmulatedBoard:
    """The emulated board, switched off and on."""

    def __init__(self, sensor: Sensor, now: int) -> None:
        self.sensor, self.boot = sensor, 14
        self.switch_on(now)

    def switch_on(self, now: int) -> None:
        self.boot += 1
        self.firmware = BoardFirmware(self.sensor, FakeBoard(self.sensor), now, self.boot)
        self.receive, self.next_due, self.due = self.firmware.receive, self.firmware.next_due, self.firmware.due


@pytest.mark.parametrize("seed", SEEDS)
def test_the_emulated_board_conforms_whatever_is_free(sensor: Sensor, seed: int) -> None:
    numbers = random.Random(seed)
    fd = numbers.random() < 0.5
    size = numbers.choice(((5, 5), (1, 1), (4, 7), (8, 8)))
    link = {
        "fd": fd,
        "base_id": numbers.randrange(0x700),
        "scan_rate": numbers.choice((50.0, 100.0, 200.0, 300.0, 320.0)),
    }
    sensor = with_layout(sensor, *size, **link)
    board = Board(
        sensor.can.base_id, sensor.layout.taxels, sensor.layout.id, fd, round(1e6 / sensor.can.scan_rate), fd_bus=True
    )
    findings, _ = findings_of(board, lambda now: EmulatedBoard(sensor, now), power_cycle=True, seed=seed)
    assert failed(findings) == {}, board
    assert unchecked(findings) == not_applicable(board)


def test_a_reset_without_a_silence_is_a_power_cycle(sensor: Sensor) -> None:
    board = Board(sensor.can.base_id, 25, sensor.layout.id, sensor.can.fd, 1000, fd_bus=True)
    findings, _ = findings_of(board, lambda now: EmulatedBoard(sensor, now), power_cycle=True, off=0)
    assert failed(findings) == {}
    assert "15 before power-on, 0 after" in findings["I4"].seen
