# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a force that is held tells of the leak rates, and that a force which moves tells nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import HOP, STEADINESS, SharedMeasurement, SteadyForce
from posfet_model.estimation.error_states import COUNT, Shared

BLOCK = 0.02
TIME = BLOCK * np.arange(16)
SHARES = np.array([0.5, 1.0, 0.3])
"""Force of each taxel, in all 1.8 N [N]."""
NOISE = 1e-8
"""Variance of the sum of the forces in a block [N2]."""


def observed(
    assumed: float,
    true: float,
    course: NDArray[np.float64] | float = 1.0,
    begun: float = 0.1,
    warmed: float = 0.0,
    steady: SteadyForce | None = None,
) -> SharedMeasurement | None:
    """Return what a window tells that begins at a time after a touch [s], integrated with an assumed time constant."""
    shares = np.multiply.outer(np.ones(len(TIME)), SHARES) * (
        course if isinstance(course, float) else np.asarray(course).reshape(len(TIME), -1)
    )
    left = np.exp(-(TIME + begun) / true)[:, None]
    charge = SHARES * left + (shares - SHARES)  # changes within the window have not leaked yet
    force = charge + (true / assumed) * (shares - charge)
    rng = np.random.default_rng(1)
    noise = np.sqrt(NOISE / len(SHARES)) * rng.standard_normal(force.shape)
    response = np.zeros((len(TIME), COUNT))
    response[:, Shared.LEAK] = -charge.sum(axis=1)
    return (steady or SteadyForce()).observe(TIME, force + noise, charge + noise, response, warmed, NOISE)


@pytest.mark.parametrize("factor", [0.8, 0.95, 1.0, 1.1, 1.25])
@pytest.mark.parametrize("begun", [0.02, 0.3])
def test_a_held_force_shows_the_error_of_the_leak_rates(factor: float, begun: float) -> None:
    found = observed(0.27, 0.27 * factor, begun=begun)
    assert found is not None
    # The error of the force is leak*(F - x); the force itself is constant.
    assert found.innovation / found.sensitivity[Shared.LEAK] == pytest.approx(factor - 1.0, abs=0.01)
    assert found.variance >= len(TIME) / HOP * STEADINESS**2


def test_other_responses_count_as_far_as_their_course_is_that_of_the_charge() -> None:
    charge = np.exp(-TIME / 0.27)
    response = np.zeros((len(TIME), COUNT))
    response[:, Shared.WARMTH] = 3.0 * charge + 2.0 * TIME + 1.0
    response[:, Shared.BEND] = 1.0
    found = SteadyForce().observe(TIME, np.ones((len(TIME), 1)), charge[:, None], response, 0.0, 1e-12)
    assert found is not None
    assert found.sensitivity[Shared.WARMTH] == pytest.approx(3.0, rel=1e-3)
    assert found.sensitivity[Shared.BEND] == pytest.approx(0.0, abs=1e-9)


def test_a_charge_that_has_leaked_away_shows_nothing() -> None:
    assert observed(0.27, 0.3, begun=3.0) is None


@pytest.mark.parametrize(("percent", "steady"), [(0.5, True), (8.0, False)])
def test_a_slow_ramp_is_steady_and_a_fast_one_is_not(percent: float, steady: bool) -> None:
    found = observed(0.27, 0.3, 1.0 + percent / 100.0 * TIME / TIME[-1])
    assert (found is not None) is steady


@pytest.mark.parametrize("hertz", [0.3, 0.6, 1.2])
def test_what_a_tremor_makes_of_it_is_covered(hertz: float) -> None:
    for phase in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        steady = SteadyForce()
        for window in range(12):
            begun = 0.05 + window * HOP * BLOCK
            tremor = 0.003 * np.sin(2.0 * np.pi * hertz * (TIME + begun) + phase)
            found = observed(0.27, 0.27, 1.0 + tremor, begun=begun, steady=steady)
            assert found is None or abs(found.innovation) <= 2.0 * np.sqrt(found.variance)


@pytest.mark.parametrize("hertz", [2.0, 5.0, 10.0])
def test_a_force_that_fluctuates_shows_nothing(hertz: float) -> None:
    assert observed(0.27, 0.3, 1.0 + 0.03 * np.sin(2.0 * np.pi * hertz * TIME)) is None


def test_an_object_that_slides_from_taxel_to_taxel_shows_nothing() -> None:
    moved = 0.1 * TIME / TIME[-1]
    course = np.stack((1.0 + moved, 1.0 - 0.5 * moved, np.ones(len(TIME))), axis=1)
    assert course[0] @ SHARES == pytest.approx(course[-1] @ SHARES)
    assert observed(0.27, 0.27, course) is None


def test_a_film_that_may_have_warmed_shows_nothing() -> None:
    assert observed(0.27, 0.3, warmed=0.01) is not None
    assert observed(0.27, 0.3, warmed=0.05) is None
