# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""When signals are still for long enough that offsets may be estimated from them."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_core.scan_path import RestDetector

NOISE, SPREAD, TAU, BLOCK = 1e-3, 0.1, 0.3, 0.02
STEP = RestDetector.STILL * NOISE
"""A change above this is a motion [N]."""
TAXELS = 9
NONE = np.zeros(TAXELS, np.bool_)
FLAT = np.linspace(-0.5, 0.5, TAXELS) * SPREAD
"""Signals as far apart as those of untouched taxels."""
UNEVEN = np.where(np.arange(TAXELS) == 0, 3 * SPREAD, FLAT)


def detector(signal: np.ndarray = FLAT, taxels: int = TAXELS) -> RestDetector:
    made = RestDetector(taxels, NOISE, SPREAD, TAU)
    made.start(signal)
    return made


def time_to_rest(made: RestDetector, signal: np.ndarray, ignored: np.ndarray = NONE) -> float:
    """Return how long the signals have to stand still, to half a block [s]."""
    for number in range(1, 1000):
        if made.update(signal, ignored, BLOCK):
            return (number - 0.5) * BLOCK
    return np.inf


def test_equal_signals_are_at_rest_while_they_stay() -> None:
    made = detector()
    assert made.update(FLAT, NONE, BLOCK)
    assert not made.update(FLAT + 2 * STEP, NONE, BLOCK)


def test_signals_that_differ_are_at_rest_only_when_a_held_force_has_leaked() -> None:
    assert time_to_rest(detector(UNEVEN), UNEVEN) == pytest.approx(RestDetector.LEAKED * TAU, abs=BLOCK)


def test_an_ignored_taxel_neither_differs_nor_moves() -> None:
    ignored = np.arange(TAXELS) == 0
    made = detector(UNEVEN)
    for number in range(4):
        assert made.update(np.where(ignored, float(number), FLAT), ignored, BLOCK)
        assert not made.moved


@pytest.mark.parametrize(
    ("moving", "change", "moved"),
    [
        (2, 1.1 * STEP, True),
        (2, -1.1 * STEP, True),
        (2, 0.9 * STEP, False),
        (1, 1.1 * STEP, False),  # it may be noisy
        (1, 1.1 * RestDetector.SINGLE_TAXEL_FACTOR * STEP, True),
    ],
)
def test_two_taxels_move_or_one_by_much(moving: int, change: float, moved: bool) -> None:
    made = detector()
    signal = FLAT.copy()
    signal[:moving] += change
    assert made.update(signal, NONE, BLOCK) is not moved
    assert made.moved is moved


def test_a_single_taxel_of_an_array_of_one_moves_by_the_usual_limit() -> None:
    made = detector(np.zeros(1), 1)
    made.update(np.array([1.1 * STEP]), np.zeros(1, np.bool_), BLOCK)
    assert made.moved


def test_a_motion_starts_the_time_again_from_the_new_signals() -> None:
    made = detector(UNEVEN)
    for _ in range(4):
        assert not made.update(UNEVEN, NONE, BLOCK)
    assert not made.update(UNEVEN + 2 * STEP, NONE, BLOCK)
    assert time_to_rest(made, UNEVEN + 2 * STEP) == pytest.approx(RestDetector.LEAKED * TAU, abs=BLOCK)


def test_a_slow_ramp_is_a_motion_as_it_adds_up() -> None:
    made, motions = detector(), 0
    for number in range(1, 101):
        assert made.update(FLAT + 0.3 * STEP * number, NONE, BLOCK) is not made.moved
        motions += made.moved
    assert motions == 25  # each time it has gone more than one step: after four blocks


def test_what_all_taxels_share_is_no_motion_while_the_chip_warms() -> None:
    cold, warm = detector(), detector()
    assert not cold.update(FLAT + 5 * STEP, NONE, BLOCK)
    assert warm.update(FLAT + 5 * STEP, NONE, BLOCK, warming=True)
    press = FLAT + 5 * STEP
    press[:3] += 2 * STEP
    assert not warm.update(press, NONE, BLOCK, warming=True)
    assert warm.moved
