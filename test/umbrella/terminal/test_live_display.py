# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The display in a terminal: what it says, and that its layout depends on the size of terminal and array alone."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from posfet.snapshot import Snapshot
from posfet.terminal.force_history import SPAN, ForceHistory
from posfet.terminal.force_map import HALVES, NUMBERS, SQUARES, fitting
from posfet.terminal.live_display import Shown, render
from posfet.terminal.screen import Screen
from support.web_sensors import SNAPSHOT, TOUCH, FakeSensor

PITCH = (1.5e-3, 1.5e-3)
SHOWN = Shown(SNAPSHOT, 999.6, 1.0, pitch=PITCH, name="tactile", keys="q quit")


def lines(shown: Shown = SHOWN, width: int = 80, height: int = 24, colours: bool = True) -> list[str]:
    console = Console(file=io.StringIO(), width=width, height=height, no_color=True)
    console.print(render(shown, width, height, colours))
    return console.file.getvalue().splitlines()


def with_snapshot(**changes: object) -> Shown:
    return replace(SHOWN, snapshot=replace(SNAPSHOT, **changes))


def array(rows: int, cols: int, **changes: object) -> Snapshot:
    force = np.zeros(rows * cols, np.float32)
    return replace(SNAPSHOT, rows=rows, cols=cols, force=force, status=None, **changes)


def test_forces_contacts_and_losses_are_shown() -> None:
    text = "\n".join(lines(width=100))
    for expected in (
        "tactile  forces valid",
        "1000 scans/s",
        "3 frames lost, 2 scans missing",
        "uncalibrated: forces may be off by 10%",
        "total force  1.250 ± 0.016 N",
        "#7 moving    +1.00  -0.50  1.250±0.004    9.0     2.5",
        "CoP error against truth: 0.05 mm max",
        "force [mN]",
        "q quit",
    ):
        assert expected in text, text


def test_a_light_true_contact_beside_another_one_is_not_compared() -> None:
    [true] = SNAPSHOT.truth
    lifting = replace(true, x=-5e-3, force=0.01)
    assert "CoP error against truth: 0.05 mm max" in "\n".join(lines(with_snapshot(truth=(true, lifting)), width=100))


def test_each_taxel_has_its_force_or_why_there_is_none() -> None:
    found = lines()
    upper = next(line for line in found if "dead" in line)
    lower = next(line for line in found if "125" in line)
    assert found.index(upper) < found.index(lower)  # y points up
    assert upper[:25].split() == ["+0.8", "0", "dead", "31"]  # -0 is 0
    assert lower[:25].split() == ["-0.8", "0", "125", "≥1150"]
    assert "-1.5  0.0   +1.5" in "\n".join(found)


def test_what_is_unknown_is_a_word() -> None:
    invalid = replace(with_snapshot(data_valid=False, contacts=()), advice="leave the sensor untouched")
    text = "\n".join(lines(invalid))
    for expected in (
        "forces unknown",
        "leave the sensor untouched",
        "total force  unknown",
        "unknown until forces are valid",
    ):
        assert expected in text
    unsure = with_snapshot(contacts=(replace(TOUCH, standard_deviation=math.nan),))
    assert "1.250±?" in "\n".join(lines(unsure))
    assert "?" in next(line for line in lines(with_snapshot(status=None)) if "31" in line)


def test_a_picture_that_is_frozen_or_old_says_so() -> None:
    assert lines(replace(SHOWN, paused=True))[1].startswith("paused")
    assert lines(replace(SHOWN, age=3.2))[1] == "no new scans for 3 s: simulated board runs"


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (60, 20), (30, 10)])
@pytest.mark.parametrize(("rows", "cols"), [(5, 5), (16, 16), (32, 32)])
def test_the_layout_does_not_flip(rows: int, cols: int, width: int, height: int) -> None:
    """Whatever happens on the sensor, each line is where it was, and none is too long."""
    base = array(rows, cols, contacts=())
    crowd = tuple(replace(TOUCH, id=number, x=-1e-7) for number in range(1, 20))
    cases = [
        base,
        replace(base, contacts=(TOUCH,)),
        replace(base, contacts=crowd, frames_lost=10**6, scans_lost=10**6),
        replace(base, data_valid=False, total_force=math.nan, force=np.full(rows * cols, math.nan, np.float32)),
    ]
    places = set()
    for snapshot in cases:
        shown = replace(SHOWN, snapshot=snapshot, message="a long line of the log " * 9, link="http://127.0.0.1:1/" * 5)
        found = lines(shown, width, height)
        assert len(found) <= height
        assert max(map(len, found)) <= width
        small = any("small terminal" in line for line in found)
        places.add((small, None if small else next(index for index, line in enumerate(found) if "contacts" in line)))
        assert not any(token in {"-0", "-0.0", "-0.00", "-0.000"} for line in found for token in line.split())
    assert len(places) == 1


def test_a_small_terminal_gets_a_smaller_view_with_a_word_on_it() -> None:
    text = "\n".join(lines(width=45, height=16))
    assert "total force 1.250 ± 0.016 N" in text
    assert "#7 moving" in text
    assert "small terminal: 53 × 21 or more shows it all" in text
    assert "small terminal" not in "\n".join(lines(width=53, height=21))


@pytest.mark.parametrize(
    ("lost", "width", "expected"),
    [
        (0, 80, "tactile  forces valid     1000 scans/s  0 frames lost, 0 scans missing"),
        (0, 64, "forces valid     1000 scans/s  0 frames lost, 0 scans missing"),
        (0, 36, "forces valid   1000 scans/s"),
        (1, 45, "forces valid  1 frame lost, 1 scan missing"),
    ],
)
def test_in_a_narrow_terminal_losses_come_before_name_and_rate(lost: int, width: int, expected: str) -> None:
    assert lines(with_snapshot(frames_lost=lost, scans_lost=lost), width)[0].strip() == expected


@pytest.mark.parametrize(
    ("rows", "cols", "width", "height", "colours", "cells"),
    [
        (5, 5, 37, 15, True, NUMBERS),
        (5, 5, 36, 15, True, SQUARES),
        (16, 16, 39, 21, True, SQUARES),
        (16, 16, 38, 21, True, HALVES),
        (16, 16, 38, 21, False, None),
        (64, 64, 70, 20, True, None),
    ],
)
def test_the_largest_cells_that_fit_are_used(
    rows: int, cols: int, width: int, height: int, colours: bool, cells: object
) -> None:
    assert fitting(rows, cols, width, height, colours) is cells


def test_without_colours_there_are_shades() -> None:
    force = np.linspace(0.0, 1.0, 16 * 16, dtype=np.float32)
    text = "\n".join(lines(replace(SHOWN, snapshot=replace(array(16, 16), force=force)), 120, 40, colours=False))
    assert "@@" in text
    odd = "\n".join(lines(replace(SHOWN, snapshot=array(33, 33)), 90, 40))
    assert odd.count("▀" * 33) == 17


def test_the_history_shows_the_largest_force_and_what_is_unknown() -> None:
    history = ForceHistory()
    for second in range(60):
        history.add(second, {40: 2.0, 50: math.nan}.get(second, -1e-3))
    assert history.full_scale == 2.0
    bars = history.bars(int(SPAN))
    assert [len(bar) for bar in bars] == [30] * 3
    newest = 59
    assert [bar[29 - (newest - 40)] for bar in bars] == ["█", "█", "█"]
    assert [bar[29 - (newest - 50)] for bar in bars] == [" ", " ", "?"]
    assert ForceHistory().bars(4) == ["    "] * 3


class Keys:
    """Keys that a test presses."""

    available = True
    waiting = ""

    def pressed(self) -> str:
        keys, self.waiting = self.waiting, ""
        return keys


def test_keys_tare_pause_and_quit() -> None:
    sensor, keys = FakeSensor(), Keys()
    console = Console(file=io.StringIO(), width=100, height=30, force_terminal=True)
    with Screen(sensor, sensor, "http://here", console) as screen:
        screen._keys = keys  # type: ignore[assignment]
        output = console.file

        def shown_after(key: str, now: float) -> str:
            begin = len(output.getvalue())
            keys.waiting = key
            screen.update(now)
            return output.getvalue()[begin:]

        assert "q quit  p pause  t tare  http://here" in shown_after("", 1.0)
        assert "tare: tare done" in shown_after("t", 2.0)
        assert sensor.requests == [("tare", False)]
        sensor.shown = replace(SNAPSHOT, total_force=0.5)
        frozen = shown_after("p", 3.0)
        assert "paused" in frozen
        assert "1.250 ±" in frozen
        assert "0.500 ±" in shown_after("p", 4.0)
        assert not screen.quit
        shown_after("q", 5.0)
        assert screen.quit


def test_what_is_waited_for_is_shown_until_the_first_scan() -> None:
    sensor = FakeSensor()
    sensor.shown = None
    console = Console(file=io.StringIO(), width=100, height=30, force_terminal=True)
    with Screen(sensor, sensor, "", console) as screen:
        screen.update(1.0)
        assert "waiting for the first scan ..." in console.file.getvalue()
        screen.waits("nothing on /palm/view/image")
        screen.update(2.0)
        assert "nothing on /palm/view/image" in console.file.getvalue()
