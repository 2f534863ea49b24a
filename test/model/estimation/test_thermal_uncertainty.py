# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the film temperature leaves in the signals, and how uncertain it makes the forces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.estimation.common_mode import CommonModeTemperature
from posfet_model.estimation.film_temperature import UNKNOWN_RANDOM_WALK, FilmTemperature
from posfet_model.estimation.settings import MISMATCH_MEMORY, PRIOR_WARMING_TIME
from posfet_model.estimation.thermal_uncertainty import ThermalUncertainty

PER_KELVIN = np.array([-0.8, -0.9, -1.0])
MISMATCH, THRESHOLD, BLOCK = 0.1, 0.05, 0.02
TAU = np.array([0.2, 0.3, 0.4])
ALL = np.ones(3, np.bool_)


def made(calibrated: bool = True, lag: float = 0.0) -> ThermalUncertainty:
    film = FilmTemperature(lag)
    film.update(np.array([25.0], np.float32), 1e-3)
    return ThermalUncertainty(
        film, CommonModeTemperature(film, -0.9, THRESHOLD, 1e-3), PER_KELVIN, MISMATCH, calibrated
    )


def close(thermal: ThermalUncertainty, touched: bool = False, blocks: int = 1) -> float:
    return [thermal.close_block(BLOCK, TAU, THRESHOLD, touched) for _ in range(blocks)][-1]


def warm(thermal: ThermalUncertainty, celsius: float, seconds: float = BLOCK) -> None:
    """Let the chip report a temperature for some time; NaN: nothing."""
    for _ in range(round(seconds / 1e-3)):
        thermal.film.update(np.array([celsius], np.float32), 1e-3)


def test_the_uncertainty_of_the_film_is_common_to_all_forces() -> None:
    thermal = made()
    assert thermal.film_variance == 0.0
    warm(thermal, math.nan, 2.0)
    expected = (UNKNOWN_RANDOM_WALK * math.sqrt(2.0) * 0.9) ** 2
    assert thermal.film_variance == pytest.approx(expected)
    assert thermal.common_variance == pytest.approx(expected)


@pytest.mark.parametrize("calibrated", [False, True])
def test_where_the_common_mode_shows_the_temperature_only_its_residual_is_left(calibrated: bool) -> None:
    thermal = made(calibrated)
    warm(thermal, math.nan, 2.0)
    thermal.common.observable = True
    known = thermal.common.residual_variance
    assert known < 0.01 * thermal.film_variance
    assert thermal.common_variance == (known if calibrated else thermal.film_variance)


def test_the_charge_of_a_temperature_step_leaks_from_the_signals() -> None:
    thermal = made()
    thermal.rise = 0.5
    close(thermal)
    for seconds in (BLOCK, 11 * BLOCK):
        assert thermal.residual_signal == pytest.approx(0.5 * PER_KELVIN * np.exp(-seconds / TAU))
        close(thermal, blocks=10)
    thermal.rise = 0.0  # and back: the charges add up
    close(thermal)
    left = np.exp(-22 * BLOCK / TAU) - np.exp(-BLOCK / TAU)
    assert thermal.residual_signal == pytest.approx(0.5 * PER_KELVIN * left)


def test_the_leakage_under_a_touch_is_known_while_the_common_mode_is_observable() -> None:
    thermal = made()
    thermal.rise = 0.5
    close(thermal, blocks=5)
    thermal.begin_touch(ALL)
    assert thermal.observed_leakage == pytest.approx(0.0)
    close(thermal, touched=True, blocks=5)
    assert thermal.observed_leakage == pytest.approx(0.0)  # nothing shows it
    thermal.common.observable = True
    close(thermal, touched=True, blocks=5)
    leaked = 0.5 * PER_KELVIN * (np.exp(-5 * BLOCK / TAU) - np.exp(-15 * BLOCK / TAU))
    assert thermal.observed_leakage == pytest.approx(leaked)
    thermal.common.observable = False
    close(thermal, touched=True, blocks=5)
    assert thermal.observed_leakage == pytest.approx(leaked)
    thermal.begin_touch(np.array([True, False, True]))
    assert thermal.observed_leakage == pytest.approx([0.0, leaked[1], 0.0])


def test_without_calibration_no_leakage_counts_as_observed() -> None:
    thermal = made(calibrated=False)
    thermal.rise = 0.5
    thermal.begin_touch(ALL)
    thermal.common.observable = True
    close(thermal, touched=True, blocks=5)
    assert thermal.observed_leakage == pytest.approx(0.0)


def test_mismatch_is_a_share_of_the_temperature_change_of_a_block() -> None:
    thermal = made()
    thermal.rise = -0.1
    expected = 0.1 * 0.9 * MISMATCH
    assert close(thermal) == pytest.approx(expected)
    assert thermal.mismatch_variance == pytest.approx((2 * expected) ** 2)
    thermal.rise -= 0.05  # half the change, but warming is irregular
    assert close(thermal) == pytest.approx(MISMATCH_MEMORY * expected)
    thermal.rise -= 0.2
    assert close(thermal) == pytest.approx(2 * expected)
    # Without a change there is none; nor with one far below what counts as a contact.
    assert close(thermal) == 0.0
    assert thermal.mismatch_variance == 0.0


def test_under_a_touch_mismatch_follows_the_greatest_change_since_the_touch_began() -> None:
    thermal = made()
    warm(thermal, 25.0)
    thermal.common.end_touch()
    total = 0.0
    for celsius in (25.2, 25.4, 25.1, 25.3, 25.0):
        warm(thermal, celsius, 1e-3)  # a new reading, which is not extrapolated yet
        total += close(thermal, touched=True)
    # The way back adds nothing, as each taxel is wrong by the same share.
    assert total == pytest.approx(0.4 * 0.9 * MISMATCH, rel=0.01)
    assert close(thermal, touched=True) == 0.0


def learnt(thermal: ThermalUncertainty, celsius: float, blocks: int = 1) -> list[tuple[bool, bool]]:
    found = []
    for _ in range(blocks):
        warm(thermal, celsius)
        found.append(thermal.learnt_during_warming(BLOCK))
    return found


def test_while_the_temperature_is_steady_offsets_are_learnt_from_no_warming() -> None:
    assert set(learnt(made(lag=0.05), 25.0, 50)) == {(False, False)}


@pytest.mark.parametrize("early", [True, False])
def test_offsets_are_doubted_when_warming_begins_and_when_it_ends(early: bool) -> None:
    thermal = made(lag=0.05)
    learnt(thermal, 25.0, 5 if early else round(2 * PRIOR_WARMING_TIME / BLOCK))
    # A chip that warms soon after the start was warming before: known offsets are in doubt, too.
    assert learnt(thermal, 26.0) == [(True, early)]
    after = learnt(thermal, 26.0, 200)
    assert (True, False) in after
    assert not any(known for _, known in after)
    assert set(after[100:]) == {(False, False)}
