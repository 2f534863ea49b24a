# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet can` with a board that has frames of its own: it listens, and sends nothing."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from posfet import can as posfet_can
from support.clocks import PacedClock
from support.fake_board import board_on_bus
from support.own_boards import BoardA, Transmitter, codes_of, sensor_a

A = BoardA()
PERIOD = 5_000_000
"""Scan period [ns]."""


@pytest.fixture(autouse=True)
def wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def clock() -> PacedClock:
    return PacedClock()


@pytest.fixture
def selected(clock: PacedClock, tmp_path: Path) -> Iterator[list[str]]:
    """A board on a virtual bus; returns the arguments that select it."""
    sensor_a(tmp_path, **{"  scan_rate_Hz: 1000.0": "  scan_rate_Hz: 200.0"})
    channel = uuid.uuid4().hex
    transmitter = Transmitter(lambda index: A.scan(index, codes_of(index)), clock.monotonic(), PERIOD)
    with can.Bus(interface="virtual", channel=channel) as bus, board_on_bus(bus, transmitter, clock):
        yield ["-i", "virtual", "-c", channel, "-s", str(tmp_path / "a.yaml")]
    assert transmitter.received == []


def test_list(selected: list[str], clock: PacedClock, capsys: pytest.CaptureFixture[str]) -> None:
    assert posfet_can.main(["list", *selected], clock) == 0
    assert "own frames" in capsys.readouterr().out


def test_monitor(selected: list[str], clock: PacedClock, capsys: pytest.CaptureFixture[str]) -> None:
    assert posfet_can.main(["monitor", *selected, "--for", "1.5"], clock) == 0
    shown = capsys.readouterr().out
    assert "0x18FF0100" in shown
    assert "TactileRow" in shown
    assert "newest scan [counts]" in shown


def test_selftest(selected: list[str], clock: PacedClock, capsys: pytest.CaptureFixture[str]) -> None:
    assert posfet_can.main(["selftest", *selected, "--for", "0.5"], clock) == 0
    shown = capsys.readouterr().out
    assert "scans are complete and in time" in shown
    assert "stamps estimated from arrivals" in shown
    assert "identifies itself" not in shown


def test_record_and_decode(
    selected: list[str], clock: PacedClock, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "bus.log")
    assert posfet_can.main(["record", file, *selected, "--for", "0.3"], clock) == 0
    assert posfet_can.main(["replay", file, "--decode", "-s", selected[-1]], clock) == 0
    cells = [cell.strip() for cell in capsys.readouterr().out.split("│")]
    assert int(cells[cells.index("complete scans") + 1]) > 30
    assert cells[cells.index("lost scans") + 1] == "0"


@pytest.mark.parametrize("words", [["command", "stop"], ["monitor", "--start", "--for", "1"], ["conform"]])
def test_commands_are_refused(
    selected: list[str], clock: PacedClock, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert posfet_can.main([*words, *selected], clock) == 1
    error = capsys.readouterr().err
    assert "the driver only listens to a board with frames of its own" in error
    assert error.count("\n") == 1


def test_the_emulator_has_other_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sensor_a(tmp_path)
    assert posfet_can.main(["monitor", "-i", "emulator", "-s", str(tmp_path / "a.yaml"), "--for", "1"]) == 1
    assert "the board has frames of its own" in capsys.readouterr().err
