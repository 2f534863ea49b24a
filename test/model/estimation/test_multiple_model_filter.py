# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Offset and temperature rise of a film with random-walk temperature drift, separated by the common-mode signal."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from posfet_model.estimation.multiple_model_filter import RESOLUTION, BlockObservation, CommonOffsetFilter

LEAKAGE, LAG, PER_KELVIN = 0.3, 0.06, 0.9
BLOCK = 0.02
STEPS = 20
"""Number of simulation steps in a block."""


def blocks(random_walk: float, offset: float, seed: int = 0, rise: float = 0.0) -> Iterator[BlockObservation]:
    """Yield blocks at rest, without end.

    The chip temperature is a random walk of intensity `random_walk` [K/sqrt(s)]; `rise` [N/s] is the rate of an
    undetected press.
    """
    random = np.random.default_rng(seed)
    step = BLOCK / STEPS
    chip = film = charge = pressed = reading = age = 0.0
    while True:
        signal = 0.0
        for _ in range(STEPS):
            warmed = (chip - film) * -math.expm1(-step / LAG)
            film += warmed
            pressed += rise * step
            charge = charge * math.exp(-step / LEAKAGE) + PER_KELVIN * warmed + rise * step
            chip += random_walk * math.sqrt(step) * random.standard_normal()
            signal += (offset + charge) / STEPS
        before, reading = reading, round(chip / RESOLUTION) * RESOLUTION
        age = 0.0 if reading != before else age + BLOCK
        yield BlockObservation(signal + 1e-5 * random.standard_normal(), 1e-10, 0.0, 0.0, 0.0, 0.0, reading, age)


def rest(shared: CommonOffsetFilter, seconds: float, random_walk: float, offset: float = 0.0, seed: int = 0) -> None:
    """Update with blocks at rest for a time [s]."""
    for _, seen in zip(range(round(seconds / BLOCK)), blocks(random_walk, offset, seed), strict=False):
        shared.update_at_rest(seen, BLOCK, BLOCK, known=True)


@pytest.mark.parametrize("offset", [-0.02, 0.0, 0.5])
@pytest.mark.parametrize("random_walk", [1e-3, 3e-3])
def test_the_offset_error_is_within_the_reported_uncertainty(random_walk: float, offset: float) -> None:
    errors = []
    for seed in range(40):
        shared = CommonOffsetFilter(LEAKAGE, LAG, PER_KELVIN, 1e-16)
        rest(shared, 2.0, random_walk, offset, seed)
        assert shared.random_walk_found
        touch = shared.begin_touch(0.0, BLOCK)
        later = shared.update_touched(0.0, math.nan, 0.0, 20.0)  # the offset error leaks
        assert later.offset == pytest.approx(touch.offset, abs=1e-9)
        drift = (touch.offset - offset) * 20.0 / LEAKAGE
        errors.append(drift / math.sqrt(shared.variance))
    # Without chip temperature the film drifts for 20 s, which is included in the variance but not in this error.
    assert np.mean(np.abs(errors) <= 2.0) >= 0.9
    assert np.sqrt(np.mean(np.square(errors))) >= 0.2


def test_no_random_walk_is_identified_for_a_film_at_rest() -> None:
    shared = CommonOffsetFilter(LEAKAGE, LAG, PER_KELVIN, 1e-16)
    rest(shared, 60.0, 0.0, 0.01)
    assert shared.at_rest
    assert not shared.random_walk_found


def test_a_signal_jump_is_not_attributed_to_temperature() -> None:
    shared = CommonOffsetFilter(LEAKAGE, LAG, PER_KELVIN, 1e-16)
    rest(shared, 2.0, 2e-3)
    assert shared.random_walk_found
    assert (
        shared.update_at_rest(BlockObservation(0.1, 1e-10, 0.0, 0.0, 0.0, 0.0, math.nan, 0.0), BLOCK, BLOCK, known=True)
        is None
    )
    assert not shared.random_walk_found


def test_a_slow_press_on_all_taxels_is_rejected_when_the_chip_temperature_disagrees() -> None:
    shared, duration = CommonOffsetFilter(LEAKAGE, LAG, PER_KELVIN, 1e-16), 0.0
    rest(shared, 2.0, 2e-3)
    for _, seen in zip(range(100), blocks(0.0, 0.0, rise=0.05), strict=False):
        shared.update_at_rest(seen, BLOCK, BLOCK, known=True)
        duration += BLOCK * shared.random_walk_found
    assert not shared.random_walk_found
    assert duration < 0.5
