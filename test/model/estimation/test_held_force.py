# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Held forces: error against the optimal estimator, and consistency of the reported uncertainty."""

from __future__ import annotations

import pytest

from reference.held_force import Held, hold
from reference.temperature_drift import Drift
from support.long_cases import long_cases

REST = "0.3 s of rest do not tell a drift of all offsets from a film that warms"
WALKS = "offsets and temperature are assumed to walk, which they hardly do here"
LOOKS = "a strong walk of the temperature looks like a ramp"


def unmet(reason: str, *case: object) -> object:
    """Return a case whose requirement is not met, which the slow tests say once it is."""
    return pytest.param(*case, marks=(pytest.mark.slow, pytest.mark.xfail(strict=True, reason=reason)))


@pytest.mark.parametrize("flicker", long_cases([0.0, 10e-6], [10e-6]))
def test_a_held_force_is_covered_with_an_error_of_a_quarter_percent(flicker: float) -> None:
    for held in hold(5, (1.0, 5.0, 20.0), flicker=flicker):
        assert held.error < 0.0025 * held.force
        assert held.inside >= 0.94


@pytest.mark.slow
def test_a_held_force_is_covered_during_a_random_walk_of_the_temperature() -> None:
    """The walk is observed in the 2 s before the touch, and what was taken for a drift until then was too certain."""
    found = [held for seed in range(8) for held in hold(seed, (1.0, 5.0), drift=Drift(random_walk=2e-3), side=8)]
    assert _ratio(found) <= 2.0
    assert _coverage(found) >= 0.94


@pytest.mark.parametrize(
    ("flicker", "rest", "times"),
    [
        *long_cases(
            [(0.0, 2.0, (1.0, 5.0, 20.0)), (10e-6, 2.0, (5.0, 20.0)), (30e-6, 2.0, (5.0, 20.0))],
            [(0.0, 2.0, (1.0, 5.0, 20.0)), (30e-6, 2.0, (5.0, 20.0))],
        ),
        *(unmet(WALKS, flicker, 2.0, (1.0,)) for flicker in (10e-6, 30e-6)),
        *(unmet(REST, flicker, 0.3, (1.0, 5.0, 20.0)) for flicker in (0.0, 10e-6, 30e-6)),
    ],
)
def test_a_held_force_is_as_accurate_as_the_optimal_estimate(
    flicker: float, rest: float, times: tuple[float, ...]
) -> None:
    # 256 taxels: a ratio has a standard error of 4 %.
    for held in hold(5, times, rest=rest, flicker=flicker):
        assert held.error <= 1.2 * held.optimal, held


@pytest.mark.parametrize("flicker", [pytest.param(0.0, marks=pytest.mark.slow), 10e-6])
def test_the_reported_two_sigma_interval_covers_the_truth_95_percent_of_the_time(flicker: float) -> None:
    inside = [held.inside for seed in range(3) for held in hold(seed, (0.5, 2.0, 10.0), flicker=flicker)]
    # 768 taxels at each time, and times that are not independent: the coverage has a standard error of 1 %.
    assert sum(inside) / len(inside) >= 0.94


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason=WALKS)
def test_the_reported_uncertainty_is_not_much_larger_than_the_error() -> None:
    for held in hold(6, (5.0, 20.0)):
        assert held.error < held.deviation < 2.0 * held.error


def test_the_optimal_estimator_leaves_only_the_uncommon_part_of_a_ramp() -> None:
    # 0.1 K at 1 N/K, of which 2 % differ at random; no random walk and no 1/f noise. The rounding is common: 1 mN at
    # most.
    drift = Drift(ramp=0.01, random_walk=0.0)
    for held in hold(3, (10.0,), flicker=0.0, drift=drift):
        assert 1e-3 < held.optimal < 2.5e-3, held


@pytest.mark.slow
@pytest.mark.parametrize("ramp", [1 / 60, 0.3])
def test_a_held_force_is_as_accurate_while_the_chip_warms(ramp: float) -> None:
    # In 20 s at 0.3 K/s the thermal uncertainty exceeds the force: pressed taxels stay classified as pressed.
    drift = Drift(ramp=ramp, random_walk=0.0)
    found = [held for seed in range(4) for held in hold(seed, (1.0, 5.0, 20.0), drift=drift, side=8)]
    assert _ratio(found) <= 1.2
    assert _coverage(found) >= 0.94  # standard error 1 %, as above


@pytest.mark.parametrize(
    ("random_walk", "limit"),
    [*(pytest.param(each, 1.35, marks=pytest.mark.slow) for each in (1e-3, 2e-3)), unmet(LOOKS, 4e-3, 2.0)],
)
def test_a_held_force_is_nearly_as_accurate_during_random_walk_temperature_drift(
    random_walk: float, limit: float
) -> None:
    # The common-mode error is one draw per seed: a ratio has a standard error of 12 %; docs/accuracy.md gives it from
    # more seeds.
    found = [held for seed in range(12) for held in hold(seed, (5.0,), drift=Drift(random_walk=random_walk), side=8)]
    assert _ratio(found) <= limit
    assert _coverage(found) >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("random_walk", [0.0, 2e-3])
def test_untouched_taxels_compensate_the_temperature_of_touched_ones(random_walk: float) -> None:
    found = [
        held
        for seed in range(32)
        for held in hold(seed, (1.0, 5.0), drift=Drift(random_walk=random_walk), side=5, untouched=15)
    ]
    assert _coverage(found) >= 0.94  # standard error 0.7 %
    assert max(held.error for held in found) <= 0.01


def _ratio(found: list[Held]) -> float:
    """Return the ratio of the error to that of the optimal estimator, both root mean square."""
    error, optimal = (sum(getattr(held, name) ** 2 for held in found) for name in ("error", "optimal"))
    return float((error / optimal) ** 0.5)


def _coverage(found: list[Held]) -> float:
    return sum(held.inside for held in found) / len(found)
