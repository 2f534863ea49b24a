# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Temperature sensors of the chip: what counts as a new reading, and their mean change."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_core.scan_path import FASTEST_WARMING, Thermometers

NAN = math.nan


def read(thermometers: Thermometers, *values: float) -> float:
    """Process readings a second after the last."""
    return thermometers.read(np.array(values, np.float32), 1.0)


def test_the_first_reading_is_the_zero_of_the_scale() -> None:
    thermometers = Thermometers()
    assert not thermometers.known
    assert read(thermometers, 25.0, 31.0) == 0.0
    assert thermometers.known


def test_a_reading_is_the_mean_change_since_the_first() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    assert read(thermometers, 25.5, 31.25) == pytest.approx(0.375)
    assert read(thermometers, 24.5, 31.0) == pytest.approx(-0.25)


def test_the_same_values_again_are_no_new_reading() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    assert math.isnan(read(thermometers, 25.0, 31.0))
    assert read(thermometers, 25.0, 31.5) == pytest.approx(0.25)
    assert math.isnan(read(thermometers, 25.0, 31.5))


def test_a_sensor_that_stops_gives_no_new_reading() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    read(thermometers, 25.5, 31.5)
    assert math.isnan(read(thermometers, 25.5, NAN))
    assert thermometers.known
    # The other one goes on, by itself.
    assert read(thermometers, 25.75, NAN) == pytest.approx(0.75)


def test_the_temperature_is_the_mean_of_all_sensors_that_ever_reported() -> None:
    thermometers = Thermometers()
    assert math.isnan(thermometers.temperature)
    read(thermometers, 25.0, 31.0)
    assert thermometers.temperature == pytest.approx(28.0)
    read(thermometers, 25.5, 31.25)
    assert thermometers.temperature == pytest.approx(28.375)
    read(thermometers, 26.0, NAN)  # the other one has warmed as much, for all that is known
    assert thermometers.temperature == pytest.approx(29.0)


def test_a_sensor_that_appears_does_not_shift_the_mean() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, NAN)
    assert read(thermometers, 26.0, NAN) == pytest.approx(1.0)
    assert read(thermometers, 26.0, 40.0) == pytest.approx(1.0)
    assert read(thermometers, 26.5, 40.5) == pytest.approx(1.5)


def test_a_sensor_that_returns_keeps_its_own_zero() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    read(thermometers, 25.0, NAN)
    assert read(thermometers, 26.0, 32.0) == pytest.approx(1.0)


@pytest.mark.parametrize("values", [(), (NAN,), (NAN, NAN)])
def test_without_a_sensor_there_is_no_reading(values: tuple[float, ...]) -> None:
    thermometers = Thermometers()
    assert math.isnan(read(thermometers, *values))
    assert not thermometers.known


def test_after_all_sensors_stopped_none_is_known() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    assert math.isnan(read(thermometers, NAN, NAN))
    assert not thermometers.known
    assert read(thermometers, 25.5, NAN) == pytest.approx(0.5)


@pytest.mark.parametrize("value", [math.inf, -math.inf])
def test_an_infinite_reading_is_none(value: float) -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    assert math.isnan(read(thermometers, 25.0, value))


def test_a_sensor_that_jumps_faster_than_a_chip_can_warm_counts_from_then_on() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    read(thermometers, 25.5, 31.5)
    jumped = 25.5 + 2.0 * FASTEST_WARMING
    assert read(thermometers, jumped, 31.5) == pytest.approx(0.5, abs=1e-6)
    assert read(thermometers, jumped + 0.25, 31.75) == pytest.approx(0.75, abs=1e-6)


def test_after_an_interruption_any_change_is_possible() -> None:
    thermometers = Thermometers()
    read(thermometers, 25.0, 31.0)
    change = 10.0 * FASTEST_WARMING
    later = np.array([25.0 + change, 31.0 + change], np.float32)
    assert thermometers.read(later, math.inf) == pytest.approx(change)


@pytest.mark.parametrize("interval", [0.1, 1.0])
def test_the_interval_of_the_readings_is_found(interval: float) -> None:
    # Scans come every 10 ms. When the first reading came is not known, and some are equal to the one before.
    thermometers, scans = Thermometers(), round(interval / 0.01)
    for number, reading in enumerate((0, 1, 2, 2, 2, 3, 2, 1)):
        if number == 2:
            assert math.isnan(thermometers.interval)
        for _ in range(scans if number else scans // 2):
            thermometers.read(np.array([25.0 + reading / 256.0], np.float32), 0.01)
    assert thermometers.interval == pytest.approx(interval)


def test_the_interval_of_the_readings_grows_slowly_and_outlasts_an_interruption() -> None:
    thermometers = Thermometers()
    for reading in range(3):
        read(thermometers, 25.0 + reading / 256.0)
    assert thermometers.interval == 1.0
    thermometers.read(np.array([25.0], np.float32), math.inf)
    assert thermometers.interval == 1.0
    for _ in range(9):
        read(thermometers, 25.0)
    read(thermometers, 25.1)
    assert thermometers.interval == pytest.approx(1.1)
