# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Negative forces become baseline errors after a while, and lower bounds last until the touch ends."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_core.scan_path import LowerBoundMonitor, NegativeForceMonitor

BLOCK = 0.02
LIMIT = 0.01
ALL = np.ones(3, np.bool_)
PRESSED_DOWN = np.array([-0.05, 0.0, 0.05])
"""Forces below the limit, within it and positive [N]."""


def confirmed(monitor: NegativeForceMonitor, blocks: int, mean: np.ndarray, still: np.ndarray = ALL) -> list[int]:
    """Return the numbers of the blocks, from 1, in which the first taxel was confirmed; no other ever is."""
    found = []
    for number in range(1, blocks + 1):
        mask = monitor.update(ALL, mean, LIMIT, still, BLOCK)
        assert not mask[1:].any()
        found += [number] * bool(mask[0])
    return found


@pytest.mark.parametrize("blocks", [1, 4, 10])
def test_a_steady_negative_force_is_confirmed_after_its_time_and_not_before(blocks: int) -> None:
    monitor = NegativeForceMonitor(3, (blocks - 0.5) * BLOCK)
    assert confirmed(monitor, 3 * blocks, PRESSED_DOWN) == [blocks, 2 * blocks, 3 * blocks]


def test_a_moving_negative_force_is_never_confirmed() -> None:
    monitor = NegativeForceMonitor(3, 3.5 * BLOCK)
    assert not confirmed(monitor, 50, PRESSED_DOWN, np.zeros(3, np.bool_))
    # The time for which it has to be steady begins when it stands still.
    assert confirmed(monitor, 4, PRESSED_DOWN) == [4]


def test_one_block_above_the_limit_starts_the_time_again() -> None:
    monitor = NegativeForceMonitor(3, 3.5 * BLOCK)
    assert not confirmed(monitor, 3, PRESSED_DOWN)
    assert not confirmed(monitor, 1, np.zeros(3))
    assert confirmed(monitor, 4, PRESSED_DOWN) == [4]


def test_taxels_that_are_not_examined_or_are_reset_start_again() -> None:
    monitor = NegativeForceMonitor(3, 3.5 * BLOCK)
    down = np.full(3, -0.05)
    for _ in range(3):
        assert not monitor.update(np.array([True, True, False]), down, LIMIT, ALL, BLOCK).any()
    assert monitor.update(ALL, down, LIMIT, ALL, BLOCK).tolist() == [True, True, False]
    for _ in range(2):
        assert not monitor.update(ALL, down, LIMIT, ALL, BLOCK).any()
    monitor.reset()
    assert not monitor.update(ALL, down, LIMIT, ALL, BLOCK).any()


def test_a_force_at_the_limit_is_possible() -> None:
    monitor = NegativeForceMonitor(3, 0.5 * BLOCK)
    assert not confirmed(monitor, 5, np.full(3, -LIMIT))
    assert confirmed(monitor, 1, np.array([np.nextafter(-0.01, -1.0), 0.0, 0.0])) == [1]


THRESHOLD = 0.1


def started(before: list[float], remaining: list[float]) -> LowerBoundMonitor:
    monitor = LowerBoundMonitor(len(before), THRESHOLD, 2.5 * BLOCK)
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


def test_nothing_is_marked_without_an_interruption() -> None:
    monitor = LowerBoundMonitor(2, THRESHOLD, BLOCK)
    monitor.update(np.array([1.0, -1.0]), BLOCK)
    assert monitor.mask.tolist() == [False, False]


def test_a_release_ends_the_mark_of_its_taxel_at_once() -> None:
    monitor = started([1.0, 1.0], [1.0, 1.0])
    monitor.update(np.array([1.0, -0.2]), BLOCK)
    assert monitor.mask.tolist() == [True, False]


def test_marks_last_while_one_marked_taxel_is_pressed() -> None:
    monitor = started([1.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    for _ in range(100):
        monitor.update(np.array([1.0, 0.0, 0.0]), BLOCK)
    assert monitor.mask.tolist() == [True, True, False]


def test_marks_end_after_the_release_time_without_a_force_on_marked_taxels() -> None:
    monitor = started([1.0, 1.0, 0.0], [0.0, 0.0, 0.0])
    quiet = np.array([0.05, -0.05, 5.0])  # the third is pressed, but not marked
    pressed = np.array([1.0, 0.0, 0.0])
    for force in (quiet, pressed, pressed, pressed, quiet):  # a press does not start the time again, and does not count
        monitor.update(force, BLOCK)
        assert monitor.mask.tolist() == [True, True, False]
    monitor.update(quiet, BLOCK)
    assert not monitor.mask.any()


def test_a_second_interruption_keeps_the_marks_of_the_first() -> None:
    monitor = started([1.0, 0.0], [0.0, 0.0])
    monitor.start(np.array([0.0, 1.0]), np.array([0.0, 0.0]))
    assert monitor.mask.tolist() == [True, True]
