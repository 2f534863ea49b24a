# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lower bounds last until the touch ends."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_core.scan_path import LowerBoundMonitor

BLOCK = 0.02
THRESHOLD = 0.1


def started(before: list[float], remaining: list[float]) -> LowerBoundMonitor:
    monitor = LowerBoundMonitor(len(before), THRESHOLD, 3.5 * BLOCK, 2.5 * BLOCK)
    monitor.start(np.array(before), np.array(remaining))
    return monitor


@pytest.mark.parametrize(
    ("before", "remaining", "marked"),
    [
        (1.0, 0.5, True),  # pressed before, and some charge is left
        (1.0, 0.0, True),  # the charge may have leaked
        (1.0, -0.5, False),  # the charge of a release
        (0.0, 0.5, True),  # pressed meanwhile
        (0.0, 0.0, False),
        (0.0, -0.5, False),
        (THRESHOLD, THRESHOLD, False),
    ],
)
def test_a_force_before_or_a_charge_after_an_interruption_bounds_the_force(
    before: float, remaining: float, marked: bool
) -> None:
    assert started([before], [remaining]).mask.tolist() == [marked]


def blocks(monitor: LowerBoundMonitor, count: int, *mean: float, still: bool = True) -> list[bool]:
    """Process blocks of these forces; return which have ended in the last one."""
    ended = np.zeros(len(mean), np.bool_)
    for _ in range(count):
        assert not ended.any()
        ended = monitor.update(np.array(mean), np.full(len(mean), still), BLOCK)
    return [bool(each) for each in ended]


def test_nothing_is_marked_and_nothing_ends_without_an_interruption() -> None:
    monitor = LowerBoundMonitor(2, THRESHOLD, BLOCK, BLOCK)
    assert blocks(monitor, 5, 1.0, -1.0) == [False, False]
    assert monitor.mask.tolist() == [False, False]


def test_a_steady_negative_force_ends_the_mark_of_its_taxel_after_its_time() -> None:
    monitor = started([1.0, 1.0], [1.0, 1.0])
    assert blocks(monitor, 3, 1.0, -0.2) == [False, False]
    assert monitor.mask.tolist() == [True, True]
    assert blocks(monitor, 1, 1.0, -0.2) == [False, True]
    assert monitor.mask.tolist() == [True, False]
    assert blocks(monitor, 1, 1.0, -0.2) == [False, False]


@pytest.mark.parametrize("between", [{"still": False}, {"force": -THRESHOLD}, {"force": 0.5}, {"again": True}])
def test_a_negative_force_that_moves_or_stops_starts_its_time_again(between: dict[str, float]) -> None:
    monitor = started([1.0, 1.0], [1.0, 1.0])
    blocks(monitor, 3, 1.0, -0.2)
    if between.get("again"):
        monitor.start(np.zeros(2), np.zeros(2))
    else:
        blocks(monitor, 1, 1.0, between.get("force", -0.2), still=bool(between.get("still", True)))
    assert blocks(monitor, 3, 1.0, -0.2) == [False, False]
    assert blocks(monitor, 1, 1.0, -0.2) == [False, True]


def test_marks_last_while_one_marked_taxel_is_pressed() -> None:
    monitor = started([1.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    blocks(monitor, 100, 1.0, 0.0, 0.0)
    assert monitor.mask.tolist() == [True, True, False]


def test_marks_end_after_the_release_time_without_a_force_on_marked_taxels() -> None:
    monitor = started([1.0, 1.0, 0.0], [0.0, 0.0, 0.0])
    quiet = (0.05, -0.05, 5.0)  # the third is pressed, but not marked
    pressed = (1.0, 0.0, 0.0)
    for force in (quiet, pressed, pressed, pressed, quiet):  # a press does not start the time again, and does not count
        blocks(monitor, 1, *force)
        assert monitor.mask.tolist() == [True, True, False]
    blocks(monitor, 1, *quiet)
    assert not monitor.mask.any()


def test_a_second_interruption_keeps_the_marks_of_the_first() -> None:
    monitor = started([1.0, 0.0], [0.0, 0.0])
    monitor.start(np.array([0.0, 1.0]), np.array([0.0, 0.0]))
    assert monitor.mask.tolist() == [True, True]
