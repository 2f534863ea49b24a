# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Overshoot, settling and slope of a step, against ngspice's and the linear ones."""

import math
from dataclasses import replace

import numpy as np
import pytest

from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.operating_point import CIRCUIT_B, TABLE_II
from posfet_model.amplifier.step_test import slew_rates, steepest_slope, step_test
from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.spice.circuits import CIRCUITS
from support.sweep import assert_refused


def of_circuit(name: str) -> CircuitFollower:
    of = CIRCUITS[name]
    return CircuitFollower.from_design(of.bias, of.design, of.stages)


@pytest.mark.parametrize(
    ("name", "percent"),  # of ngspice, a step of 50 mV with an edge of 10 ns
    [
        ("two_stage", 0.0),
        ("two_stage_100pf", 13.98),
        ("two_stage_300pf", 31.98),
        ("two_stage_no_zero_resistor", 109.78),
        ("two_stage_small_rz_30pf", 71.39),
        ("one_stage_100pf", 31.36),
        ("one_stage_half_cc_30pf", 23.98),
        ("one_stage_300khz_300pf", 26.06),
    ],
)
def test_the_overshoot_of_50_mv_is_that_of_ngspice(name: str, percent: float) -> None:
    assert 100 * step_test(of_circuit(name)).overshoot == pytest.approx(percent, abs=1.0)


def test_a_tiny_step_has_the_linear_overshoot_and_settling_time() -> None:
    follower = CircuitFollower(circuit=of_circuit("one_stage_100pf").circuit, tolerance=1e-8)
    found = step_test(follower, 1e-3)
    assert found.overshoot == pytest.approx(float(follower.figures.overshoot), abs=5e-3)
    assert found.settling_time == pytest.approx(float(follower.figures.settling_time), rel=0.05)


def test_a_large_step_slews() -> None:
    rising = step_test(of_circuit("two_stage"), 2.0).slope
    assert rising == pytest.approx(4.85e6, rel=0.1)  # of ngspice, steepest
    follower = of_circuit("one_stage_100pf")
    falling = step_test(follower, -1.0, 0.5).slope
    assert falling == pytest.approx(float(follower.figures.falling_slew_rate), rel=0.2)


@pytest.mark.parametrize(
    ("name", "rise", "fall"),  # of ngspice, on the same step, in V/us
    [
        ("two_stage", 4.7925, 3.4243),
        ("two_stage_100pf", 4.7098, 1.6148),
        ("two_stage_59db_300khz", 0.4353, 0.3024),
        ("one_stage", 3.3368, 3.1048),
        ("one_stage_60db_1pf", 1.5169, 1.4885),
        ("one_stage_300khz_300pf", 0.9231, 0.2818),
    ],
)
def test_the_slew_rates_are_those_of_ngspice(name: str, rise: float, fall: float) -> None:
    assert slew_rates(of_circuit(name)) == pytest.approx((rise * 1e6, fall * 1e6), rel=1e-3)


def test_the_steepest_slope_is_that_of_the_ramp_between_round_corners() -> None:
    time = np.linspace(0, 10, 501)
    corners = np.interp(time, [0, 2, 3, 6, 7, 10], [0, 0, 0.2, 3.2, 3.4, 3.4])
    assert steepest_slope(time, corners, 3.4) == pytest.approx(1)
    assert steepest_slope(time, -2 * corners, -6.8) == pytest.approx(2)
    assert math.isnan(steepest_slope(time, corners, 5.0))


def test_an_unstable_follower_has_none() -> None:
    found = step_test(of_circuit("two_stage_no_rz_unstable"))
    assert all(math.isnan(rate) for rate in slew_rates(of_circuit("two_stage_no_rz_unstable")))
    assert math.isnan(found.overshoot) and found.settling_time == math.inf


def test_an_output_without_load_and_a_pair_that_is_cut_off() -> None:
    free = CircuitFollower.from_design(replace(CIRCUIT_B, load_capacitance=0.0))
    assert step_test(free).overshoot < 0.01 and free.figures.phase_margin > 90
    off = CircuitFollower.from_design(CIRCUIT_B, replace(TABLE_II, pair_threshold_shift=20.0))
    assert math.isnan(step_test(off).overshoot) and not off.validity.valid


def test_what_is_refused() -> None:
    good = {"follower": of_circuit("two_stage"), "volts": 0.05, "start": 0.0}
    assert_refused(step_test, {**good, "volts": 0.0}, "volts")
    assert_refused(step_test, {**good, "start": 30.0}, "start")
    many = CircuitFollower(circuit=AmplifierCircuit.stack([AmplifierCircuit.from_design()] * 2))
    assert_refused(step_test, {**good, "follower": many}, "follower")
    good = {"follower": of_circuit("two_stage"), "low": -0.5, "high": 1.5}
    assert_refused(slew_rates, {**good, "low": 1.5}, "low")
    assert_refused(slew_rates, {**good, "high": 30.0}, "high")
    assert_refused(slew_rates, {**good, "follower": many}, "follower")
