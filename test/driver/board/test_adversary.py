# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver against the reference firmware behind a link with every fault, and lies; the long run is in make soak."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import cast

import pytest

from support import adversary
from support.adversary import FAULTS, SECOND, Adversary, Findings, campaign, describe, main, variants
from support.adversary_link import BASE, Link, LoggedBoard
from support.clocks import SteppedClock
from support.long_cases import crossed, long_cases
from support.reference_board import COMPILER, make

SCANS = {"FD 5x5 1 kHz": 110_000, "classic 5x5 1 kHz": 70_000, "FD 8x8 500 Hz": 70_000, "classic 5x5 250 Hz": 50_000}
SHORT = {"FD 5x5 1 kHz": 23_000, "classic 5x5 250 Hz": 8_000}
"""In the ordinary run, with frames of either kind: about as many as it takes for every fault to happen."""


@pytest.fixture(scope="session")
def plain_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware's process; the workers of pytest-xdist share it."""
    if COMPILER is None:
        pytest.skip("needs a C compiler and make")
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if base.name.startswith("popen-") else base) / "firmware"
    make(folder, f"{folder}/posfet_board")
    return folder / "posfet_board"


def test_the_short_runs_have_the_scans_that_are_stated() -> None:
    assert SCANS.keys() == variants().keys() > SHORT.keys()
    assert sum(SCANS.values()) == 300_000
    assert sum(SHORT.values()) == 31_000


@pytest.mark.parametrize(("name", "scans"), long_cases([*SHORT.items(), *SCANS.items()], SHORT.items()))
def test_every_published_scan_is_what_the_board_has_sampled(plain_program: Path, name: str, scans: int) -> None:
    found = campaign(plain_program, name, scans, seed=1)
    assert not found.failures, describe(name, found, 0.0)
    assert found.published >= scans
    assert found.faults.keys() == set(FAULTS)
    assert found.lost > 0
    assert found.stretches > 100


def test_a_run_of_a_single_fault_has_its_memory_measured(plain_program: Path) -> None:
    found = campaign(plain_program, "FD 5x5 1 kHz", 500, seed=1)
    assert sum(found.faults.values()) <= 3
    assert len(found.memory) == 4


@pytest.mark.parametrize(
    ("counted", "name"),
    long_cases(
        crossed([1.0, 0.9], ["FD 5x5 1 kHz", "classic 5x5 1 kHz"]),
        ["1.0-FD 5x5 1 kHz", "0.9-FD 5x5 1 kHz", "0.9-classic 5x5 1 kHz"],
    ),
)
def test_losses_that_the_driver_does_not_count_are_found(
    plain_program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, counted: float
) -> None:
    bench = Adversary(plain_program, tmp_path, variants()[name], seed=1)
    statistics, report = bench.board.decoder.statistics, bench.board.report

    class Counted:
        lost_scans = property(lambda _: int(counted * statistics.lost_scans))
        incomplete_scans = property(lambda _: statistics.incomplete_scans)

    monkeypatch.setattr(
        bench.judge, "_board", SimpleNamespace(decoder=SimpleNamespace(statistics=Counted()), report=report)
    )
    bench.board.open()
    bench.read(SECOND, calm=True)
    for _ in range(8):
        bench.fault(["frames lost", "host delayed"])
    found = bench.judge.findings
    bench.board.close()
    assert bench.hardware.close() == 0
    assert found.stretches > 50
    assert found.failures.keys() == ({"silent loss"} if counted < 1.0 else set()), found.examples


def test_an_adapter_that_stalls_holds_back_no_frame_longer_than_the_one_that_overtakes_it() -> None:
    """Else a classic block could be late by 16 scans, in which its counter is the same again."""
    sent = deque((time * 1_000_000, (BASE + 8, 0, bytes([time]))) for time in range(1, 11))
    board = SimpleNamespace(now=0, host_time=lambda time: time, run_until=lambda _: [sent.popleft()])
    link = Link(
        SteppedClock(),
        cast(LoggedBoard, board),
        False,
        cast(Random, SimpleNamespace(random=lambda: 0.0, getrandbits=lambda _: 1)),
    )
    link.begin("frames reordered")
    link.run(1)
    link.begin("adapter stalls")
    for _ in range(9):
        link.run(1)
    link.end()
    link.clock.now = SECOND
    board.now = 2 * SECOND  # nothing more is sent
    assert [frame[2][0] for frame in link.read_frames(0.0)] == [2, 1, *range(3, 11)]


@pytest.mark.parametrize(("seed", "scans"), long_cases([(1, 1000), (2, 7000)], [(1, 1000)]))
def test_lies_about_period_and_sequence_invent_no_losses_and_delay_no_scan_after_them(
    plain_program: Path, seed: int, scans: int
) -> None:
    """A period of 1 us made any jump plausible, and one of 10 s let silence last for 100 s, whatever came after it."""
    lies = ("lie: period", "lie: sequence", "lie: not scanning")
    found = campaign(plain_program, "classic 5x5 250 Hz", scans, seed, lies)
    assert not found.failures, found.examples


def test_a_number_that_a_lie_has_frozen_is_that_of_the_lie_also_when_the_scan_that_had_it_was_lost(
    plain_program: Path, tmp_path: Path
) -> None:
    bench = Adversary(plain_program, tmp_path, variants()["FD 5x5 1 kHz"], seed=3)
    bench.board.open()
    bench.read(SECOND, calm=True)
    bench.link.begin("lie: frozen sequence")
    bench.judge.lie_begins(bench.clock.now, 0)
    for _ in range(60):
        bench.link.begin("frames lost")  # the sequence is frozen again, at a number that may be lost
        bench.read(SECOND // 30, calm=False)
    found = bench.judge.findings
    bench.board.close()
    assert bench.hardware.close() == 0
    assert not found.failures, found.examples
    assert found.false_numbers > 0


@pytest.mark.parametrize("seed", long_cases([1, 2], [1]))
def test_a_reset_under_the_same_number_after_a_brown_out_lets_no_sequence_fall_and_no_stamp_leave_its_bound(
    plain_program: Path, tmp_path: Path, seed: int
) -> None:
    """Each power-on repeats numbers and times of the one before, and some of the responses are lost."""
    bench = Adversary(plain_program, tmp_path, variants()["classic 5x5 250 Hz"], seed)
    bench.board.open()
    bench.read(SECOND, calm=True)
    for _ in range(25):
        bench.fault(["brown-out", "frames lost", "reset, same number"])
    found = bench.judge.findings
    bench.board.close()
    assert bench.hardware.close() == 0
    assert not found.failures, found.examples


def test_a_frozen_sequence_is_not_taken_for_one_that_begins_again(plain_program: Path, tmp_path: Path) -> None:
    bench = Adversary(plain_program, tmp_path, variants()["classic 5x5 250 Hz"], seed=1)
    bench.board.open()
    bench.read(SECOND, calm=True)
    for phase in range(16):
        bench.link.begin("lie: frozen sequence")
        bench.judge.lie_begins(bench.clock.now, 0)
        bench.read(SECOND + phase * SECOND // 250, calm=False)
        bench.link.end()
        bench.judge.lies_end(bench.clock.now)
        bench.read(SECOND, calm=False)
    found = bench.judge.findings
    bench.board.close()
    assert bench.hardware.close() == 0
    assert not found.failures, found.examples
    assert bench.board.restarted > 0
    assert bench.board.decoder.resets == 0


@pytest.mark.parametrize("bad", [False, True])
def test_a_campaign_prints_every_variant_and_fails_with_one_of_them(
    bad: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if COMPILER is None:
        pytest.skip("needs a C compiler and make")

    def found(program: Path, name: str, scans: int, seed: int, faults: Sequence[str]) -> Findings:
        assert list(faults) == list(FAULTS[:2])
        findings = Findings(published=scans)
        if bad and name == "FD 8x8 500 Hz":
            findings.fail("stamp", "a day late")
        return findings

    monkeypatch.setattr(adversary, "ProcessPoolExecutor", ThreadPoolExecutor)
    monkeypatch.setattr(adversary, "campaign", found)
    assert main(["--scans", "4000", "--fault", FAULTS[0], "--fault", FAULTS[1]]) == bad
    output = capsys.readouterr().out
    assert all(f"{name}: 1000 scans published" in output for name in variants())
    assert ("BAD: stamp: 1\nstamp: a day late" in output) == bad
