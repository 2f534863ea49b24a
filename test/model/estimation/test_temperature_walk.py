# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.
"""The random walk of the chip temperature, observed through a film that lags behind."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_core.scan_path import TemperatureWalk

BLOCK, LAG, LEAST = 0.02, 0.05, 0.4e-3


def observed(walk: float, seconds: float, seed: int, noise: float = 0.0, rate: float = 0.0) -> TemperatureWalk:
    """Return the observer of a film that follows a chip with this walk [K/sqrt(s)], noise [K] and rate [K/s]."""
    random, fine = np.random.default_rng(seed), 1e-3
    steps = walk * math.sqrt(fine) * random.standard_normal(round(seconds / fine)) + rate * fine
    chip = np.cumsum(steps)
    film, now = np.empty_like(chip), -rate * LAG  # it has followed for long
    for index, each in enumerate(chip):
        now += -math.expm1(-fine / LAG) * (each - now)
        film[index] = now
    means = film.reshape(-1, round(BLOCK / fine)).mean(axis=1)
    means += noise * random.standard_normal(len(means))
    found = TemperatureWalk(LEAST, LAG)
    for rise in np.diff(means).tolist():
        found.observe(rise, noise * noise, BLOCK)
    return found


@pytest.mark.parametrize("noise", [0.0, 0.2e-3])
@pytest.mark.parametrize("walk", [1e-3, 4e-3])
def test_the_intensity_of_a_walk_is_found_within_noise(walk: float, noise: float) -> None:
    # 100 observations at a time: 14 % of the intensity, 7 % of its square root, and less in the mean of four.
    found = [math.sqrt(observed(walk, 30.0, seed, noise).intensity) for seed in range(4)]
    assert np.mean(found) == pytest.approx(walk, rel=0.15)


@pytest.mark.parametrize("rate", [0.0, 1.0 / 60.0, 1.0])
def test_a_constant_rate_is_no_walk(rate: float) -> None:
    found = observed(0.0, 2.0, 1, rate=rate)
    assert found.intensity == pytest.approx(LEAST**2, rel=0.6)


def test_one_sudden_change_of_the_rate_counts_for_little() -> None:
    found = observed(LEAST, 10.0, 2)
    before = found.intensity
    for rise in (0.0, 0.02, *(0.02,) * 20):
        found.observe(rise, 0.0, BLOCK)
    assert found.intensity < 2.0 * before


def test_temperatures_before_a_pause_are_not_compared_with_those_after() -> None:
    found = observed(LEAST, 2.0, 3)
    before = found.intensity
    found.pause()
    for _ in range(9):
        found.observe(0.1, 0.0, BLOCK)
    assert found.intensity == before
