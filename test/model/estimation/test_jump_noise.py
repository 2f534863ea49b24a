# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Steps of single signals at rest, and the random walk of the force errors that they make."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import DWELL, JUMP_MEMORY, JumpNoise

Array = NDArray[np.float64]
BLOCK = 0.02
TAU = np.array([0.27, 0.27, 0.5])
NOISE = np.full(3, 1e-4**2)
ALL = np.ones(3, np.bool_)
NONE = np.zeros(3)
LEAK = 1.0 + (0.5 * DWELL / TAU) ** 2


def rest(each: JumpNoise, seconds: float, change: Array | None = None, where: NDArray[np.bool_] = ALL) -> JumpNoise:
    for _ in range(round(seconds / BLOCK)):
        each.observe(where, NONE, np.zeros(3) if change is None else change, NOISE, BLOCK)
    return each


def test_steps_of_a_taxel_are_its_noise_and_no_other_ones() -> None:
    each, random = JumpNoise(TAU), np.random.default_rng(1)
    step = np.array([0.0, 1e-3, 0.0])
    for _ in range(60):
        rest(each, random.exponential(1.0))
        rest(each, 2 * BLOCK, step)  # from the block before it, and to the one after it
        step = -step
    variance = np.asarray(each.variance(2.0))
    # Sixty steps, of which the last JUMP_MEMORY seconds count: a standard error of a fifth.
    assert variance[1] == pytest.approx(2.0 * 1e-6 * LEAK[1], rel=0.6)
    assert variance[0] == variance[2] == 0.0
    offset = np.asarray(each.least_offset_variance())
    assert offset[1] == pytest.approx(0.5e-3**2, rel=0.6)  # half a step
    assert offset[0] == offset[2] == 0.0


def test_the_random_walk_covers_that_of_a_signal_with_two_levels() -> None:
    # 400 signals that switch at random every `DWELL` on average, and the sum of what their offsets leak.
    random, tau, count = np.random.default_rng(2), 0.27, 400
    level = np.where(random.random(count) < 0.5, 1.0, -1.0) * 0.5e-3
    squares, leaked = 0.0, np.zeros(count)
    seconds = 100.0
    for _ in range(round(seconds / BLOCK)):
        flipped = np.where(random.random(count) < BLOCK / DWELL, -level, level)
        squares += float(np.square(flipped - level).mean())
        level = flipped
        leaked += level * (BLOCK / tau)
    each = JumpNoise(np.full(1, tau))
    fall = -math.sqrt(squares / seconds * BLOCK)  # one that is seen twice in every block has this mean square
    for _ in range(round(10.0 * JUMP_MEMORY / BLOCK)):
        each.observe([True], [0.0], [fall], [0.0], BLOCK)
    # The steps themselves are in the variance as if they did not return. 400 values: a standard error of 7 %.
    ratio = float(np.asarray(each.variance(seconds))[0] / np.var(leaked + level))
    assert 0.9 < ratio < 1.2 * LEAK[0] / (LEAK[0] - 1.0)


def test_noise_is_no_step() -> None:
    each, random = JumpNoise(TAU), np.random.default_rng(3)
    for _ in range(3000):
        each.observe(ALL, NONE, random.normal(0.0, np.sqrt(2.0 * NOISE)), NOISE, BLOCK)
    assert not each.variance(1.0).any() and not each.least_offset_variance().any()


def test_a_rise_may_be_a_touch() -> None:
    each = rest(JumpNoise(TAU), 5.0)
    each.observe(ALL, NONE, np.full(3, 1e-3), NOISE, BLOCK)
    assert not each.variance(1.0).any()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_step_that_is_certain_counts_as_one_in_each_dwell(sign: float) -> None:
    each = rest(JumpNoise(TAU), 20.0)
    each.observe(ALL, np.array([sign * 1e-3, 0.0, 0.0]), NONE, NOISE, BLOCK)
    assert np.asarray(each.variance(2.0)) == pytest.approx([2.0 / DWELL * 1e-6 * LEAK[0], 0.0, 0.0])
    assert np.asarray(each.least_offset_variance())[0] == pytest.approx(0.5e-3**2)


def test_taxels_that_do_not_count_keep_what_was_observed() -> None:
    each, some = rest(JumpNoise(TAU), 5.0), np.array([False, True, True])
    each.observe(some, NONE, np.array([-1e-3, -1e-3, 0.0]), NOISE, BLOCK)
    assert (np.asarray(each.variance(1.0)) > 0.0).tolist() == [False, True, False]


def test_a_taxel_that_no_longer_steps_is_trusted_again() -> None:
    each = rest(JumpNoise(TAU), 5.0)
    each.observe(ALL, NONE, np.array([-1e-3, 0.0, 0.0]), NOISE, BLOCK)
    before = np.asarray(each.variance(1.0)).copy()
    after = np.asarray(rest(each, 3.0 * JUMP_MEMORY).variance(1.0))
    assert 0.0 < after[0] < 0.1 * before[0]


def test_falls_of_several_taxels_may_be_a_release() -> None:
    each = rest(JumpNoise(TAU), 5.0)
    each.observe(ALL, NONE, np.array([-1e-3, -1e-3, 0.0]), NOISE, BLOCK)
    assert not each.variance(1.0).any()
