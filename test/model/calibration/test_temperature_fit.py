# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lag of the film, pyroelectric gain and the temperature dependence of the leakage, from a change of temperature."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model._lib.types import Array
from posfet_model.calibration.leaky_response import block_means, low_pass
from posfet_model.calibration.temperature_fit import TemperatureFit, fit_temperature
from support.long_cases import crossed, long_cases

STEP = 1e-3
BLOCK = 20
TAU = 0.26
FILM_LAG = 0.05
PER_KELVIN = -1.04
DRIFT = 3e-4
BEGIN = 10.0


def signals(per_kelvin: float, sensor_lag: float, left: float = 0.0, dead: float = 0.0) -> tuple[Array, Array, Array]:
    """Return time [s], reading [K] and common-mode signal [N] of blocks while the chip is cooled and warmed.

    The film's charge leaks with a rate that rises by `per_kelvin`, solved in steps of a millisecond; the leakage is
    compensated as at the start. `left` is what presses before leave of force [N]; `dead` is a dead time of the sensors
    [s].
    """
    time = STEP * np.arange(30_000, dtype=np.float64)
    chip = np.interp(time, [BEGIN, BEGIN + 2.0, BEGIN + 6.0, BEGIN + 8.0], [0.0, -1.5, 1.5, 0.0])
    film = low_pass(time, chip, FILM_LAG)
    change = np.diff(PER_KELVIN * film, prepend=0.0)
    kept = np.exp(-STEP / TAU * np.exp(per_kelvin * film))
    charge = np.zeros(len(time))
    for index in range(1, len(time)):
        charge[index] = charge[index - 1] * kept[index] + change[index] * math.sqrt(kept[index])
    leaked = 0.5 * (charge[1:] + charge[:-1]) * STEP / TAU
    common = charge + np.concatenate([[0.0], np.cumsum(leaked)]) + DRIFT * time
    common += left * np.minimum(time / (0.5 * BEGIN), 1.0)
    reading = low_pass(time, np.interp(time - dead, time, chip), sensor_lag)
    reading += 2e-3 * np.random.default_rng(1).standard_normal(len(time))
    return block_means(time, BLOCK), block_means(reading, BLOCK), block_means(common, BLOCK)


def fitted(per_kelvin: float, sensor_lag: float, left: float = 0.0) -> TemperatureFit:
    time, reading, common = signals(per_kelvin, sensor_lag, left)
    return fit_temperature(time, reading, common, time > BEGIN - 1.0, FILM_LAG, 0.0, TAU)


@pytest.mark.parametrize("sensor_lag", long_cases([0.002, 0.1, 1.0], [0.002, 1.0]))
@pytest.mark.parametrize(
    "per_kelvin", long_cases([0.0, math.log(2.0) / 15.0, math.log(2.0) / 10.0], [0.0, math.log(2.0) / 10.0])
)
def test_leakage_that_depends_on_the_temperature_is_found(per_kelvin: float, sensor_lag: float) -> None:
    found = fitted(per_kelvin, sensor_lag)
    assert found.leak_per_kelvin == pytest.approx(per_kelvin, abs=2e-3)
    assert found.leak_per_kelvin_deviation < 6e-3
    assert found.newton_per_kelvin == pytest.approx(PER_KELVIN, rel=5e-3)
    assert found.lag == pytest.approx(FILM_LAG - sensor_lag, abs=0.01)


@pytest.mark.parametrize(
    ("sensor_lag", "dead"), long_cases([(0.0, 1.0), (0.5, 0.5), (0.0, 0.2), (1.0, 0.0)], [(0.5, 0.5), (0.0, 0.2)])
)
def test_a_dead_time_of_the_sensors_is_told_from_a_lag(sensor_lag: float, dead: float) -> None:
    # Sensors that are wholly dead for a second differed from those with a lag by 68 mK, and were refused.
    time, reading, common = signals(0.0, sensor_lag, dead=dead)
    found = fit_temperature(time, reading, common, time > BEGIN - 1.0, FILM_LAG, 0.0, TAU)
    assert FILM_LAG - found.lag == pytest.approx(sensor_lag + dead, abs=0.02)
    assert found.dead_share == pytest.approx(dead / (sensor_lag + dead), abs=0.13)
    assert float(np.std(found.residuals)) < 4e-3


@pytest.mark.parametrize(
    ("noise", "step"), long_cases(crossed([2e-3, 20e-3], [0.0, 1.0 / 16.0]), ["0.02-0.0", "0.002-0.0625"])
)
def test_noise_and_rounding_of_the_readings_are_found(noise: float, step: float) -> None:
    # Ten readings a second, interpolated. Assumed to be right within 3.5 mK, others made forces where nothing was.
    time, chip, common = signals(0.0, 0.1)
    at = np.arange(0.0, time[-1], 0.1)
    read = np.interp(at, time, chip) + noise * np.random.default_rng(2).standard_normal(len(at))
    rounded = np.rint(read / step) * step if step else read
    found = fit_temperature(time, np.interp(time, at, rounded), common, time > BEGIN - 1.0, FILM_LAG, 0.0, TAU)
    assert found.reading_deviation > 0.6 * noise
    assert found.reading_deviation > 0.3 * step / math.sqrt(12.0)  # at rest rounding errors stay the same, and hidden
    assert found.reading_deviation < 1.4 * math.hypot(noise, step / math.sqrt(12.0))


def test_charge_that_seems_to_leak_more_slowly_in_the_warmth_is_something_else() -> None:
    assert fitted(-0.02, 0.1).leak_per_kelvin == 0.0


def test_what_presses_leave_behind_is_no_leakage() -> None:
    # It shifts the signal as the temperature's way down and up does where leakage depends on it.
    assert fitted(0.0, 0.1, left=0.04).leak_per_kelvin == pytest.approx(0.0, abs=2e-3)


def test_the_drift_is_that_of_the_whole_recording() -> None:
    assert fitted(0.046, 0.1).drift == pytest.approx(DRIFT, abs=1e-4)
