# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The film temperature from sensors that are slow, noisy, or missing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.estimation.film_temperature import FilmTemperature

STEP = 1e-3


def follow(film: FilmTemperature, readings: list[tuple[float, float]], step: float = STEP) -> list[float]:
    """Return the change of the film temperature after each pair of readings."""
    total, history = 0.0, []
    for pair in readings:
        total += film.update(np.array(pair, np.float32), step)
        history.append(total)
    return history


def test_the_film_follows_a_chip_temperature_step_with_its_lag() -> None:
    film = FilmTemperature(0.05)
    history = follow(film, [(25.0, 25.0)] + [(26.0, 26.0)] * 100)
    # First order from the step on, until a new reading is overdue and the slope is discarded.
    assert history[0] == 0.0
    assert history[50] == pytest.approx(1 - math.exp(-1), abs=0.02)
    assert history[-1] == pytest.approx(1 - math.exp(-2), abs=0.02)


def test_without_lag_the_film_has_the_chip_temperature() -> None:
    film = FilmTemperature(0.0)
    ramp = [(25.0 + 0.01 * k, 24.0 + 0.01 * k) for k in range(100)]
    np.testing.assert_allclose(follow(film, ramp), 0.01 * np.arange(100), rtol=0, atol=5e-6)


def test_readings_at_10_hz_are_extrapolated_along_a_ramp() -> None:
    film = FilmTemperature(0.0)
    ramp = [(25.0 + 0.1 * (k // 100), 25.0 + 0.1 * (k // 100)) for k in range(4000)]
    history = np.array(follow(film, ramp))
    truth = 1e-3 * np.arange(4000)
    # Without extrapolation the last reading lags 0.1 K behind at the end of each 0.1 s.
    assert np.abs(history - truth)[3000:].max() < 0.01


def test_extrapolation_stops_after_a_ramp_ends() -> None:
    film = FilmTemperature(0.0)
    ramp = [(25.0 + 0.1 * min(k // 100, 20),) * 2 for k in range(3000)]
    assert follow(film, ramp)[-1] == pytest.approx(2.0, abs=1e-4)


def test_an_appearing_or_failing_sensor_causes_no_jump() -> None:
    film = FilmTemperature(0.0)
    nan = math.nan
    readings = [(nan, 30.0), (25.0, 30.0), (25.0, 30.0), (25.0, nan), (25.5, nan), *[(25.5, 30.5)] * 10, (nan, 30.5)]
    history = follow(film, readings)
    np.testing.assert_allclose(history[:6], [0, 0, 0, 0, 0.5, 0.5], rtol=0, atol=2e-3)
    # The slope of that step is followed until a new reading is overdue: then the film is back at the last reading.
    np.testing.assert_allclose(history[-2:], [0.5, 0.5], rtol=0, atol=2e-3)


def test_the_last_temperature_is_kept_with_growing_uncertainty_while_unknown() -> None:
    film = FilmTemperature(0.05)
    follow(film, [(25.0, 25.0)] * 10)
    assert film.known
    assert film.standard_deviation == 0.0
    history = follow(film, [(math.nan, math.nan)] * 1000)
    assert not film.known
    assert history[-1] == 0.0
    assert film.standard_deviation == pytest.approx(0.05, rel=0.01)
    history = follow(film, [(26.0, 26.0)] * 1000)
    assert history[-1] == pytest.approx(1.0, abs=1e-3)
    assert film.standard_deviation < 1e-3


def test_without_any_reading_the_change_is_zero_and_not_nan() -> None:
    film = FilmTemperature(0.05)
    assert follow(film, [(math.nan, math.nan)] * 10) == [0.0] * 10
    assert math.isfinite(film.standard_deviation)


def test_sensor_noise_is_included_in_the_standard_uncertainty() -> None:
    film = FilmTemperature(0.0)
    noise = np.random.default_rng(5).normal(25.0, 0.01, (200, 2))
    follow(film, [tuple(pair) for pair in noise.tolist()], step=0.1)
    # The error of a prediction: noise of the mean of two readings, now and before.
    assert film.standard_deviation == pytest.approx(0.01, rel=0.5)


def test_a_common_mode_correction_is_limited_to_the_fastest_film_change() -> None:
    film = FilmTemperature(0.05)
    follow(film, [(25.0, 25.0)] * 2)
    assert film.common_mode_correction(1e-4, 0.0, extend=True) == 1e-4
    assert film.common_mode_correction(1.0, 0.0, extend=True) == pytest.approx(2e-3, abs=1e-12)
    assert film.common_mode_correction(-1e-4, 0.0, extend=True) == pytest.approx(-1e-4, abs=1e-12)


def test_a_sensor_that_reports_nan_gives_no_new_reading() -> None:
    """Of two sensors that report 10 times a second along a ramp, the second fails: the film follows the other alike."""
    nan = math.nan
    ramp = [25.0 + 0.05 * (k // 100) for k in range(3000)]
    both, one = FilmTemperature(0.05), FilmTemperature(0.05)
    sound = follow(both, [(value, value) for value in ramp])
    failing = follow(one, [(value, value if k < 1000 else nan) for k, value in enumerate(ramp)])
    np.testing.assert_array_equal(failing, sound)
    assert (one.age, one.standard_deviation, one.steady) == (both.age, both.standard_deviation, both.steady)


def test_a_sensor_that_drops_out_between_two_readings_gives_no_new_reading() -> None:
    film = FilmTemperature(0.05)
    follow(film, [(25.0, 24.0)] * 50)
    age = film.age
    follow(film, [(25.0, math.nan), (25.0, 24.0), (math.nan, 24.0)] * 10)
    assert film.age == pytest.approx(age + 30 * STEP)
    assert film.known
