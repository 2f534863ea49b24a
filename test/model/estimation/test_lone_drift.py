# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Drifts of single taxels while all else is still."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import HOP, LoneDrift
from reference.estimation.lone_drift import LoneDrift as Reference

Array = NDArray[np.float64]
BLOCK = 0.02
NOISE = 5e-5
"""Of the mean of a block [N]."""
FORCE = 1e-3 * np.array([0, 0, 0, 0, 0, 0, 60, 80, 20, 0, 0, 90, 150, 60, 0, 0, 20, 60, 10, 0, 0, 0, 0, 0, 0], float)
"""A ball on 25 taxels [N]."""
LISTED = FORCE >= 10e-3
ALL = np.ones(25, np.bool_)
KNOWN = BLOCK * (LoneDrift.BLOCKS + (LoneDrift.WINDOWS - 1) * HOP)
"""Time after which a drift that is there is known [s]."""
WINDOW = BLOCK * (LoneDrift.BLOCKS - 1)


def alone(taxel: int) -> Array:
    return np.eye(25)[taxel]


def play(
    course: Callable[[float], Array], seconds: float, seed: int = 1, each: LoneDrift | None = None
) -> list[tuple[float, LoneDrift.Drift]]:
    """Return what is found in a hold of the ball with some course of errors [N], and when [s]."""
    drift, random, found = each or LoneDrift(25), np.random.default_rng(seed), []
    for block in range(1, round(seconds / BLOCK) + 1):
        mean = FORCE + course(BLOCK * block) + NOISE * random.standard_normal(25)
        now = drift.observe(mean, ALL, LISTED, LISTED, NOISE**2, BLOCK)
        if now:
            found.append((BLOCK * block, now))
    return found


@pytest.mark.parametrize("taxel", np.flatnonzero(LISTED).tolist())
@pytest.mark.parametrize("rate", [-4e-3, 4e-3])
def test_a_drift_of_one_taxel_is_found(taxel: int, rate: float) -> None:
    (time, found), *_ = play(lambda now: rate * now * alone(taxel), 2.0)
    assert time == pytest.approx(KNOWN)
    assert found.taxel == taxel
    assert found.rate == pytest.approx(rate, rel=0.1)
    assert (found.earliest, found.latest) == pytest.approx((KNOWN, WINDOW))


def test_it_cannot_have_begun_while_all_was_still() -> None:
    (time, found), *_ = play(lambda now: 4e-3 * max(now - 2.0, 0.0) * alone(11), 4.0)
    assert 2.0 + WINDOW < time < 2.0 + KNOWN + 0.2
    assert 2.0 - WINDOW - BLOCK < time - found.earliest < 2.0 + BLOCK


def test_what_was_found_is_not_found_for_longer() -> None:
    first, second, *_ = play(lambda now: 4e-3 * now * alone(11), 4.0)
    assert second[1].earliest == pytest.approx(second[0] - first[0])


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_no_drift(seed: int) -> None:
    assert not play(lambda _: np.zeros(25), 60.0, seed)


def test_creep_is_that_of_all() -> None:
    assert not play(lambda now: 0.03 * now * FORCE, 3.0)


def test_what_neighbours_feel_is_a_force() -> None:
    beside = alone(12) + 0.5 * (alone(11) + alone(13) + alone(7) + alone(17))
    assert not play(lambda now: 10e-3 * now * beside, 3.0)


def test_a_force_that_moves_leaves_taxels_for_others() -> None:
    assert not play(lambda now: 10e-3 * now * (alone(11) - alone(13)), 3.0)


@pytest.mark.parametrize("time_constant", [0.2, 0.5, 1.0])
def test_what_warms_or_cools_is_no_drift(time_constant: float) -> None:
    assert not play(lambda now: 10e-3 * np.exp(-now / time_constant) * alone(8), 5.0)


def test_only_taxels_in_contact_drift() -> None:
    assert not play(lambda now: 4e-3 * now * alone(0), 3.0)


def test_forgets_the_last_blocks() -> None:
    each = LoneDrift(25)
    assert not play(lambda now: 4e-3 * now * alone(11), KNOWN - BLOCK, 1, each)
    each.restart()
    assert not play(lambda now: 4e-3 * now * alone(11), KNOWN - BLOCK, 1, each)


@pytest.mark.parametrize("seed", range(10))
def test_finds_what_the_reference_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    compiled, reference, found = LoneDrift(9), Reference(9), 0
    for _ in range(6):
        force = 0.1 * random.random(9) * (random.random(9) < 0.5)
        rate = 5e-3 * random.standard_normal(9) * (random.random(9) < 0.15)
        listed, counts = force > 5e-3, random.random(9) < 0.9
        for block in range(int(random.integers(10, 120))):
            duration = BLOCK * (1.0 + 0.1 * random.random())
            mean = force + rate * BLOCK * block + 5e-5 * random.standard_normal(9)
            arguments = (mean, counts, listed, listed, 5e-5**2, duration)
            now, expected = compiled.observe(*arguments), reference.observe(*arguments)
            assert (now is None) == (expected is None)
            if now and expected:
                found += 1
                assert (now.taxel, now.rate, now.earliest, now.latest) == pytest.approx(tuple(expected), rel=1e-9)
        if random.random() < 0.3:
            compiled.restart()
            reference.restart()
    assert found or seed
