# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The temperature that the least-loaded taxels give, and the press on the whole array that is no temperature."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.estimation.common_mode import DEVIATIONS, FEWEST, NOTICEABLE, TRIAL, CommonModeTemperature
from posfet_model.estimation.film_temperature import FASTEST_CORRECTION, UNKNOWN_RANDOM_WALK, FilmTemperature

PER_KELVIN, THRESHOLD = -0.9, 0.1
STEP, BLOCK = 1e-3, 0.02
TAXELS = 10
FOREVER = 1e9
"""Lag with which the film never follows the chip [s]."""


def made(lag: float = FOREVER, noise: float = 0.0) -> tuple[FilmTemperature, CommonModeTemperature]:
    film = FilmTemperature(lag)
    film.update(np.array([25.0], np.float32), STEP)
    return film, CommonModeTemperature(film, PER_KELVIN, THRESHOLD, noise)


def unknown_for(film: FilmTemperature, seconds: float) -> float:
    """Let no sensor report; return the standard deviation of the film temperature [K]."""
    for _ in range(round(seconds / STEP)):
        film.update(np.array([math.nan], np.float32), STEP)
    return UNKNOWN_RANDOM_WALK * math.sqrt(seconds)


def trial(force: float, celsius: float) -> tuple[FilmTemperature, float, list[float]]:
    """Let an untouched array read `force` [N], corrected, while the chip is at `celsius`, until a trial has ended.

    Return the film, the sum of the corrections in the trial [K], and the changes that ended blocks made [K].
    """
    film, common = made()
    total, changes = 0.0, [common.update(np.full(TAXELS, force), BLOCK, False)]
    assert common.active
    while common.active and len(changes) < 100:
        for _ in range(round(BLOCK / STEP)):
            film.update(np.array([celsius], np.float32), STEP)
            total += common.update_untouched(np.full(TAXELS, force - total * PER_KELVIN))
        changes.append(common.update(np.full(TAXELS, force - total * PER_KELVIN), BLOCK, False))
        if len(changes) - 1 >= round(TRIAL / BLOCK):
            break
    return film, total, changes


def test_a_film_that_is_known_is_not_corrected() -> None:
    _, common = made()
    assert common.update_untouched(np.full(TAXELS, 1.0)) == 0.0
    assert not common.observable


@pytest.mark.parametrize("share", [-0.9, 0.5, 0.9])
def test_an_uncertain_film_is_corrected_at_once(share: float) -> None:
    film, common = made()
    change = share * DEVIATIONS * unknown_for(film, 1.0)
    assert common.update_untouched(np.full(TAXELS, change * PER_KELVIN)) == pytest.approx(change)
    assert film.correction == pytest.approx(change)
    assert common.observable


@pytest.mark.parametrize("sign", [-1, 1])
def test_but_by_no_more_than_its_uncertainty(sign: int) -> None:
    film, common = made()
    limit = DEVIATIONS * unknown_for(film, 1.0)
    force = np.full(TAXELS, sign * 2.0 * limit * PER_KELVIN)
    assert common.update_untouched(force) == pytest.approx(sign * limit)
    assert not common.observable
    assert common.update_untouched(force) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("touched", [0, 4, 7])
def test_touches_on_most_taxels_do_not_count(touched: int) -> None:
    film, common = made()
    unknown_for(film, 1.0)
    force = np.full(TAXELS, 0.09)
    force[:touched] = 5.0
    assert common.update_untouched(force) == pytest.approx(0.09 / PER_KELVIN)


@pytest.mark.parametrize("touched", [False, True])
def test_too_few_taxels_give_no_temperature(touched: bool) -> None:
    film, common = made()
    unknown_for(film, 4.0)
    update = common.update_touched if touched else common.update_untouched
    assert update(np.full(FEWEST - 1, 0.09)) == 0.0
    assert common.update(np.full(FEWEST - 1, 0.09), BLOCK, touched) == 0.0
    assert update(np.full(FEWEST, 0.09)) != 0.0


def test_a_component_too_small_to_notice_starts_no_trial() -> None:
    _, common = made()
    assert common.update(np.full(TAXELS, 0.99 * NOTICEABLE * THRESHOLD), BLOCK, False) == 0.0
    assert not common.active
    assert common.update(np.full(TAXELS, 1.01 * NOTICEABLE * THRESHOLD), BLOCK, True) == 0.0  # nor under a touch
    assert not common.active
    assert common.update(np.full(TAXELS, 1.01 * NOTICEABLE * THRESHOLD), BLOCK, False) == 0.0
    assert common.active


def test_a_correction_on_trial_is_no_faster_than_a_film() -> None:
    film, common = made()
    common.update(np.full(TAXELS, 5.0), BLOCK, False)
    for number in range(1, 6):
        film.update(np.array([25.0], np.float32), STEP)
        assert common.update_untouched(np.full(TAXELS, 5.0)) == pytest.approx(-FASTEST_CORRECTION * STEP)
        assert film.correction == pytest.approx(-number * FASTEST_CORRECTION * STEP)


def test_a_correction_that_the_chip_does_not_confirm_is_reverted() -> None:
    film, total, changes = trial(0.18, 25.0)
    assert total == pytest.approx(-0.2)
    assert changes[:-1] == [0.0] * round(TRIAL / BLOCK)
    assert changes[-1] == pytest.approx(0.2)
    assert film.correction == 0.0


@pytest.mark.parametrize(("share", "kept"), [(1.2, True), (1.0, True), (-1.0, False)])
def test_a_correction_is_kept_when_the_chip_goes_the_same_way(share: float, kept: bool) -> None:
    film, total, changes = trial(0.18, 25.0 - 0.2 * share)
    assert total == pytest.approx(-0.2, rel=0.01)
    assert (changes[-1] == 0.0) is kept
    assert (film.correction != 0.0) is kept


def test_after_a_rejection_no_trial_starts_until_the_press_has_ended() -> None:
    film, common = made()
    press, none = np.full(TAXELS, 0.18), np.zeros(TAXELS)
    for _ in range(round(TRIAL / BLOCK) + 1):
        film.update(np.array([25.0], np.float32), STEP)
        common.update_untouched(press)
        common.update(press, BLOCK, False)
    assert not common.active
    for mean in (press, press, none):
        common.update(mean, BLOCK, False)
        assert not common.active
    common.update(press, BLOCK, False)
    assert common.active


def under_touch(
    film: FilmTemperature, common: CommonModeTemperature, force: np.ndarray, scans: int
) -> tuple[float, list[bool]]:
    """Return the sum of the corrections [K] while these forces [N] are corrected, and where they were observable."""
    total, observable = 0.0, []
    for _ in range(scans):
        film.update(np.array([math.nan], np.float32), STEP)
        total += common.update_touched(force - total * PER_KELVIN)
        observable.append(common.observable)
    return total, observable


def test_under_a_touch_the_least_loaded_taxels_correct_the_temperature() -> None:
    film, common = made()
    limit = DEVIATIONS * unknown_for(film, 1.0)
    force = np.full(TAXELS, 0.5 * limit * abs(PER_KELVIN))
    force[:6] += 2.0
    total, observable = under_touch(film, common, force, 200)
    assert total == pytest.approx(-0.5 * limit, rel=1e-3)
    assert observable[-1]


def test_a_press_on_all_taxels_loses_nothing_while_the_temperature_is_known() -> None:
    _, common = made()
    for _ in range(200):
        assert common.update_touched(np.full(TAXELS, 0.1)) == 0.0
        assert not common.observable


def test_a_press_on_all_taxels_far_beyond_the_uncertainty_is_no_temperature() -> None:
    film, common = made()
    limit = DEVIATIONS * unknown_for(film, 1.0)
    total, observable = under_touch(film, common, np.full(TAXELS, 3.0 * limit * abs(PER_KELVIN)), 200)
    assert total == pytest.approx(0.0, abs=1e-12)
    assert not any(observable)


def test_a_press_within_twice_the_uncertainty_takes_no_more_than_that() -> None:
    film, common = made()
    limit = DEVIATIONS * unknown_for(film, 1.0)
    total, observable = under_touch(film, common, np.full(TAXELS, 1.5 * limit * abs(PER_KELVIN)), 200)
    grown = DEVIATIONS * UNKNOWN_RANDOM_WALK * math.sqrt(1.2)
    assert total == pytest.approx(-grown, rel=1e-3)
    assert not observable[-1]


def test_the_change_since_a_touch_began_is_that_of_sensors_and_correction() -> None:
    film, common = made(lag=0.0)
    film.update(np.array([25.5], np.float32), STEP)
    assert common.change_since_touch == pytest.approx(0.5)
    common.end_touch()
    assert common.change_since_touch == 0.0
    film.update(np.array([25.2], np.float32), STEP)
    assert common.change_since_touch == pytest.approx(0.3, abs=1e-5)  # readings are float32


def test_a_taxel_without_pyroelectric_response_shows_no_temperature() -> None:
    film = FilmTemperature(0.05)
    common = CommonModeTemperature(film, 0.0, THRESHOLD, 0.0)
    assert common.update(np.full(TAXELS, 5.0), BLOCK, False) == 0.0
    assert not common.active


def test_the_residual_is_what_is_too_small_to_notice() -> None:
    assert made()[1].residual_variance == pytest.approx((NOTICEABLE * THRESHOLD) ** 2)
