# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The common-mode component removed from forces and from the baseline tracking of each taxel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.estimation.common_mode import TRIAL, CommonModeTemperature
from posfet_model.estimation.common_mode_correction import FEW, OFTEN, SELDOM, CommonModeCorrector
from posfet_model.estimation.drift_filter import DriftFilter
from posfet_model.estimation.film_temperature import FASTEST_CORRECTION, FilmTemperature
from posfet_model.estimation.leakage_identification import LeakageIdentifier
from posfet_model.estimation.multiple_model_filter import RESOLUTION
from posfet_model.estimation.thermal_uncertainty import ThermalUncertainty

TAXELS, TAU, LAG, THRESHOLD, NOISE = 9, 0.3, 0.06, 0.1, 1e-3
STEP, BLOCK, SCANS = 1e-3, 0.02, 20
PER_KELVIN = np.linspace(-0.8, -1.0, TAXELS)
TYPICAL = -0.9
ALL, NONE = np.ones(TAXELS, np.bool_), np.zeros(TAXELS, np.bool_)


class Bench:
    """A corrector with all that it works on; by default the film does not follow the chip by itself."""

    def __init__(self, lag: float = 1e9, threshold: float = THRESHOLD) -> None:
        self.force = np.zeros(TAXELS)
        time_constant, variance = np.full(TAXELS, TAU), np.full(TAXELS, NOISE**2)
        self.film = FilmTemperature(lag)
        self.film.update(np.array([25.0], np.float32), STEP)
        common = CommonModeTemperature(self.film, TYPICAL, threshold, 0.0)
        self.thermal = ThermalUncertainty(self.film, common, PER_KELVIN, 0.02, True)
        self.drift = DriftFilter(time_constant, variance, 0.0, 0.0)
        self.drift.restart(ALL, np.zeros(TAXELS), np.full(TAXELS, 1e-8), np.zeros(TAXELS), np.zeros(TAXELS))
        leakage = LeakageIdentifier(time_constant, variance, 0.1, 0.1)
        self.corrector = CommonModeCorrector(self.force, self.drift, leakage, self.thermal, threshold)
        self.leaked = np.zeros(TAXELS)

    def scans(self, celsius: float, touched: bool = False, count: int = SCANS) -> None:
        for _ in range(count):
            change = self.film.update(np.array([celsius], np.float32), STEP)
            self.thermal.rise += change
            self.corrector.film_rise += change
            self.corrector.compensate(self.force, touched)

    def close(self, touched: bool = False, signal: np.ndarray | None = None) -> None:
        signal = np.zeros(TAXELS) if signal is None else signal
        self.corrector.begin_block(self.leaked)
        self.leaked = self.leaked + (signal - self.drift.offset) * BLOCK / TAU
        self.corrector.measure(self.leaked, BLOCK, SCANS)
        self.corrector.close_block(self.force.copy(), touched, signal, ALL, True, BLOCK)


def test_an_uncertain_temperature_is_taken_out_of_each_force_by_its_own_response() -> None:
    bench = Bench()
    bench.scans(math.nan, count=1000)
    bench.force += -0.05 * PER_KELVIN
    before = bench.thermal.rise
    bench.corrector.compensate(bench.force, False)
    change = bench.thermal.rise - before
    assert change == pytest.approx(-0.05, rel=0.1)
    assert bench.force == pytest.approx((-0.05 - change) * PER_KELVIN)
    assert bench.corrector.film_rise == bench.thermal.rise


def test_under_a_touch_the_least_loaded_taxels_are_brought_to_zero_and_the_touch_stays() -> None:
    bench = Bench()
    bench.scans(math.nan, count=1000)
    untouched = bench.corrector.film_rise
    bench.force += -0.05 * PER_KELVIN
    bench.force[:3] += 2.0
    bench.scans(math.nan, touched=True, count=300)
    assert bench.force[3:] == pytest.approx(0.0, abs=3e-3)
    assert bench.force[:3] == pytest.approx(2.0, abs=6e-3)
    assert bench.thermal.rise == pytest.approx(-0.05, abs=3e-3)
    # What a touch corrected is no part of the temperature that offsets are estimated with.
    assert bench.corrector.film_rise == untouched


def test_a_slow_press_on_the_whole_array_is_given_back_when_the_chip_stays_cold() -> None:
    bench = Bench()
    bench.force += 0.3
    bench.close()
    blocks = round(TRIAL / BLOCK)
    taken = []
    for _ in range(blocks + 1):
        bench.scans(25.0)
        taken.append(0.3 - bench.force.min())
        bench.close()
    assert taken[1] > 0.0
    assert max(taken) > 0.2
    assert max(taken) <= FASTEST_CORRECTION * TRIAL * np.abs(PER_KELVIN).max() + 1e-12
    assert bench.force == pytest.approx(0.3, abs=1e-9)
    assert bench.thermal.rise == pytest.approx(0.0, abs=1e-9)
    assert bench.drift.variance == pytest.approx(NOISE**2)


def test_a_warming_that_the_chip_confirms_stays_out_of_the_forces() -> None:
    bench = Bench()
    bench.force += -0.3 * PER_KELVIN
    bench.close()
    for _ in range(round(TRIAL / BLOCK) + 2):
        bench.scans(24.7)
        bench.close()
    assert np.abs(bench.force).max() < 0.05
    assert bench.thermal.rise == pytest.approx(-0.3, abs=0.05)


def test_the_median_of_untouched_taxels_is_subtracted_from_them_alone() -> None:
    bench = Bench()
    mean = np.arange(9.0)
    touched = np.arange(9) >= 6
    bench.corrector.subtract_common_mode(mean, touched, True)
    assert mean.tolist() == [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 6.0, 7.0, 8.0]


@pytest.mark.parametrize(
    ("touched", "observable"),
    [
        (np.arange(9) >= 6, False),
        (np.arange(9) >= FEW - 1, True),  # too few are free
        (NONE, True),  # nothing touches, and no random walk is found
    ],
)
def test_otherwise_nothing_is_subtracted(touched: np.ndarray, observable: bool) -> None:
    mean = np.arange(9.0)
    Bench().corrector.subtract_common_mode(mean, touched, observable)
    assert mean.tolist() == list(range(9))


def test_faulty_taxels_do_not_count() -> None:
    bench = Bench()
    usable = np.arange(9) < 5
    bench.corrector.set_usable(usable)
    mean = np.array([0.0, 1.0, 2.0, 3.0, 9.0, 50.0, 60.0, 70.0, 80.0])
    bench.corrector.subtract_common_mode(mean, np.arange(9) == 4, True)
    assert mean[:4].tolist() == [-2.0, -1.0, 0.0, 1.0]
    bench.scans(math.nan, count=1000)
    bench.force[:5], bench.force[5:] = 0.05, -5.0
    bench.corrector.compensate(bench.force[usable], False)
    assert np.abs(bench.force[:5]).max() < 0.01


def test_at_rest_few_blocks_are_processed_and_fewer_once_that_is_sure() -> None:
    bench = Bench(LAG, 0.01)  # hum and the like are a share of the threshold, and would hide a small random walk
    due = []
    for number in range(1000):
        if bench.corrector.due:
            due.append(number)
        bench.film.update(np.array([25.0], np.float32), BLOCK)
        bench.close(signal=np.full(TAXELS, 0.02))
    gaps = np.diff(due)
    assert due[0] == OFTEN - 1
    assert set(gaps.tolist()) <= {OFTEN, SELDOM}
    assert gaps[0] == OFTEN
    assert gaps[-1] == SELDOM
    assert np.abs(bench.force).max() == 0.0


def test_without_a_random_walk_a_touch_changes_no_force_and_no_offset() -> None:
    bench = Bench()
    bench.force += 1.0
    bench.corrector.begin_touch(ALL, np.zeros(TAXELS, np.intp), BLOCK)
    bench.corrector.update_touched(BLOCK)
    assert bench.force.tolist() == [1.0] * TAXELS
    assert bench.drift.offset.tolist() == [0.0] * TAXELS


def random_walk(bench: Bench, seconds: float, intensity: float, offset: float) -> None:
    """Let the chip temperature be a random walk [K/sqrt(s)]; the forces are compensated without error."""
    random = np.random.default_rng(2)
    chip = film = reading = 0.0
    charge = np.zeros(TAXELS)
    for scan in range(round(seconds / STEP)):
        warmed = (chip - film) * -math.expm1(-STEP / LAG)
        film += warmed
        charge = charge * math.exp(-STEP / TAU) + PER_KELVIN * warmed
        chip += intensity * math.sqrt(STEP) * random.standard_normal()
        if scan % 100 == 0:  # the sensors report at 10 Hz
            reading = round(chip / RESOLUTION) * RESOLUTION
        change = bench.film.update(np.array([25.0 + reading], np.float32), STEP)
        bench.thermal.rise += change
        bench.corrector.film_rise += change
        if scan % SCANS == SCANS - 1:
            bench.close(signal=offset + charge + 1e-5 * random.standard_normal(TAXELS))


def test_a_random_walk_of_the_temperature_is_found_and_the_common_offset_in_it() -> None:
    bench = Bench(LAG)
    random_walk(bench, 10.0, 3.2e-3, 0.02)
    assert bench.corrector.offset.random_walk_found
    assert bench.corrector.due
    assert bench.drift.offset.mean() == pytest.approx(0.02, abs=2e-3)
    mean = np.full(TAXELS, 0.01)
    bench.corrector.subtract_common_mode(mean, NONE, False)  # no baseline may follow it
    assert mean.tolist() == [0.0] * TAXELS
    assert bench.corrector.learnt_during_warming(BLOCK) == (False, False)
