# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Steps of single signals are told from steps of a force."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import STEP_HALF, signal_steps
from reference.estimation.signal_steps import signal_steps as reference

Array = NDArray[np.float64]
TIME = 0.02 * np.arange(2 * STEP_HALF + 1)
SINCE = TIME - TIME[STEP_HALF]
AFTER = (SINCE > 0.0) + 0.5 * (SINCE == 0.0)
TAU = np.array([0.27, 0.27, 0.5])
NOISE = 1e-4
STEP = 20.0 * NOISE


def found(course: Array, taxel: int = 1, tau: Array = TAU, seed: int = 0) -> Array:
    """Return the steps that are seen when one taxel has a course, and the others only noise."""
    force = np.random.default_rng(seed).normal(0.0, NOISE, (len(TIME), len(TAU)))
    force[:, taxel] += course
    variance = np.full(len(TAU), NOISE**2)
    step = signal_steps(TIME, force, variance, tau)
    np.testing.assert_allclose(step, reference(TIME, force, variance, tau), rtol=1e-9)
    return step


def step_of_signal(step: float, tau: float) -> Array:
    """Return the uncorrected force that a step of the signal makes."""
    return step * (AFTER + np.maximum(SINCE, 0.0) / tau)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("drift", [0.0, 5e-3])
def test_a_step_of_a_signal_is_seen(sign: float, drift: float) -> None:
    seen = [found(step_of_signal(sign * STEP, TAU[1]) + drift * TIME, seed=seed) for seed in range(20)]
    assert np.mean([step[1] == pytest.approx(sign * STEP, rel=0.3) for step in seen]) >= 0.9
    assert not any(step[[0, 2]].any() for step in seen)


@pytest.mark.parametrize("rise", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("force", [0.3 * STEP, STEP, 50.0 * STEP])
def test_a_force_is_no_step_of_a_signal(force: float, rise: float) -> None:
    course = force * (np.clip(SINCE / rise, 0.0, 1.0) if rise else AFTER)
    # Measured: 0.5 % at 20 deviations, 3.5 % at 15, which are the worst.
    assert np.mean([found(course, seed=seed).any() for seed in range(100)]) <= 0.02


def test_a_force_that_moves_from_taxel_to_taxel_is_no_step_of_a_signal() -> None:
    force = np.multiply.outer(step_of_signal(STEP, TAU[0]), [1.0, -1.0, 0.0])
    assert not signal_steps(TIME, force, np.full(3, NOISE**2), TAU).any()
    assert signal_steps(TIME, force * [1.0, 0.0, 0.0], np.full(3, NOISE**2), TAU)[0] == pytest.approx(STEP)


def test_with_a_long_time_constant_both_look_the_same() -> None:
    assert not any(found(step_of_signal(STEP, 10.0), tau=np.full(3, 10.0), seed=seed).any() for seed in range(20))


def test_windows_of_a_wrong_size_are_refused() -> None:
    with pytest.raises(ValueError, match="a row for each block"):
        signal_steps(TIME[1:], np.zeros((len(TIME), 3)), np.ones(3), TAU)
