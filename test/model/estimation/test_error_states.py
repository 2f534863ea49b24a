# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Shared states: their transition against differential equations solved by other means."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import SharedDynamics
from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.estimation.error_states import BENDS, COUNT, CREEPS, ErrorPriors, Shared
from posfet_model.sensor.description import load_sensor
from reference.estimation.error_states import start_covariance, start_mean

Array = NDArray[np.float64]
BLOCK = 0.02
LAGS = [0.0, 1e-6, 0.06, 5.0, 1e9]


def state(sensor_lag: float = 0.4) -> Array:
    """Return a state in which everything differs from zero."""
    result = np.linspace(0.1, 1.0, COUNT)
    result[Shared.LAG] = math.log(sensor_lag)
    return result


def dynamics(film_lag: float = 0.06) -> SharedDynamics:
    return SharedDynamics(ErrorPriors(), film_lag)


def exponential(rates: Array) -> Array:
    """Return the matrix exponential by scaling, Taylor series and squaring.

    Scaled to a norm below 1/16, the remainder after 13 terms is below (1/16)^13/13! = 4e-26; each squaring doubles the
    relative rounding error.
    """
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(rates).sum(axis=1).max()), 1e-300))) + 4)
    scaled = rates / 2.0**squarings
    term = result = np.eye(len(rates))
    for order in range(1, 14):
        term = term @ scaled / order
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def thermal_rates(film_lag: float, sensor_lag: float) -> Array:
    """Return the differential equations in the docstring of the dynamics, for chip, rate, film and sensors."""
    rates = np.zeros((4, 4))
    rates[0, 1] = 1.0
    rates[2, [0, 2]] = 1.0 / film_lag, -1.0 / film_lag
    rates[3, [0, 3]] = 1.0 / sensor_lag, -1.0 / sensor_lag
    return rates


@pytest.mark.parametrize("duration", [1e-3, BLOCK, 1.0])
@pytest.mark.parametrize("film_lag", [1e-3, 0.06, 5.0])
@pytest.mark.parametrize("sensor_lag", [0.01, 0.4, 15.0])
def test_the_temperatures_follow_their_differential_equations(
    film_lag: float, sensor_lag: float, duration: float
) -> None:
    start = state(sensor_lag)
    after, matrix, _ = dynamics(film_lag).transition(start, duration)
    solved = exponential(thermal_rates(film_lag, sensor_lag) * duration)
    # The rounding of 1 - mean and of the squarings: at most 1e3 units of 2^-53 each.
    np.testing.assert_allclose(after[:4], solved @ start[:4], rtol=0, atol=5e-13)
    np.testing.assert_allclose(matrix[:4, :4], solved, rtol=0, atol=5e-13)


def test_all_other_states_stay() -> None:
    start = state()
    after, matrix, _ = dynamics().transition(start, BLOCK)
    np.testing.assert_array_equal(after[4:], start[4:])
    np.testing.assert_array_equal(matrix[4:], np.eye(COUNT)[4:])


@pytest.mark.parametrize("film_lag", LAGS)
@pytest.mark.parametrize("sensor_lag", [0.002, 0.02, 0.4, 15.0])
def test_the_matrix_is_the_derivative_of_the_transition(film_lag: float, sensor_lag: float) -> None:
    model, start, step = dynamics(film_lag), state(sensor_lag), 1e-5
    _, matrix, _ = model.transition(start, BLOCK)
    for column in range(COUNT):
        change = step * np.eye(COUNT)[column]
        slope = (model.transition(start + change, BLOCK)[0] - model.transition(start - change, BLOCK)[0]) / (2 * step)
        # Central differences: a third of step^2 times the third derivative, about 100 at most for the shortest lag
        # and below 1 otherwise, and rounding of 2^-53/step.
        np.testing.assert_allclose(matrix[:, column], slope, rtol=0, atol=3e-9, err_msg=str(column))


def test_a_film_without_lag_has_the_temperature_of_the_chip() -> None:
    after, _, _ = dynamics(film_lag=0.0).transition(state(), BLOCK)
    assert after[Shared.FILM] == pytest.approx(after[Shared.CHIP], rel=1e-15)


def test_a_film_or_sensor_that_hardly_follows_keeps_its_temperature() -> None:
    start = state()
    start[Shared.LAG] = 700.0  # beyond the range of exp would be an overflow; the time constant is limited to 20 s
    after, matrix, _ = dynamics(film_lag=1e9).transition(start, BLOCK)
    assert after[Shared.FILM] == pytest.approx(start[Shared.FILM], abs=1e-10)
    assert abs(after[Shared.SENSOR] - start[Shared.SENSOR]) <= BLOCK / math.exp(3.0)
    assert np.isfinite(matrix).all()


def test_sensors_far_faster_than_a_block_show_the_chip() -> None:
    start = state()
    start[Shared.LAG] = -700.0  # the time constant is limited to 0.9 ms
    after, matrix, _ = dynamics().transition(start, BLOCK)
    assert abs(after[Shared.SENSOR] - after[Shared.CHIP]) <= start[Shared.RATE] * math.exp(-7.0)
    assert np.isfinite(matrix).all()


@pytest.mark.parametrize("lag", [-20.0, 10.0])
def test_beyond_its_limits_the_lag_changes_nothing(lag: float) -> None:
    start = state()
    start[Shared.LAG] = lag
    _, matrix, _ = dynamics().transition(start, BLOCK)
    assert matrix[Shared.SENSOR, Shared.LAG] == 0.0


def test_the_process_noise_is_a_covariance_proportional_to_time() -> None:
    model = dynamics()
    once, ten = (model.transition(state(), duration)[2] for duration in (BLOCK, 10 * BLOCK))
    np.testing.assert_allclose(ten, 10 * once, rtol=1e-12)
    np.testing.assert_array_equal(once, once.T)
    values = np.linalg.eigvalsh(once)
    assert values[0] >= -1e-15 * values[-1]


def test_chip_and_film_wander_together() -> None:
    noise = dynamics().transition(state(), BLOCK)[2]
    both = [Shared.CHIP, Shared.FILM]
    np.testing.assert_allclose(noise[np.ix_(both, both)], ErrorPriors().film_walk ** 2 * BLOCK, rtol=1e-12)


def test_a_chip_that_warms_fast_may_soon_warm_less() -> None:
    # A warm finger: its heat flow decays within a second. Without this, the film would go on warming for the filter.
    fast, steady = state(), state()
    fast[Shared.RATE], steady[Shared.RATE] = -2.0, 0.0
    rates = [dynamics().transition(each, BLOCK)[2][Shared.RATE, Shared.RATE] for each in (fast, steady)]
    assert rates[0] - rates[1] == pytest.approx((2.0 * ErrorPriors().rate_change) ** 2 * BLOCK, rel=1e-12)
    assert ErrorPriors().rate_change >= 1.0


def test_a_slow_drift_goes_on_where_the_lag_of_the_sensors_is_known() -> None:
    # If its rate could change as soon as that of a warm finger, a pad on all taxels would be taken for a change of it.
    def share(priors: ErrorPriors, rate: float) -> float:
        moving, steady = state(), state()
        moving[Shared.RATE], steady[Shared.RATE] = rate, 0.0
        model = SharedDynamics(priors, 0.06)
        noise = [model.transition(each, BLOCK)[2][Shared.RATE, Shared.RATE] for each in (moving, steady)]
        return math.sqrt((noise[0] - noise[1]) / BLOCK) / abs(rate)

    priors = ErrorPriors()
    known = priors.with_calibration(calibration(temperature_sensor_lag=0.1))
    for rate in (0.5 / 60.0, -3.0):
        assert share(priors, rate) == pytest.approx(priors.rate_change, rel=1e-6)
    assert share(known, -0.5 / 60.0) < 0.06 * priors.rate_change
    assert share(known, 3.0) > 0.7 * priors.rate_change


@pytest.mark.parametrize(("lag", "deviation"), [(0.002, 0.0162), (0.1, 0.0335), (1.0, 0.3004)])
def test_a_lag_of_the_sensors_is_known_as_well_as_readings_show_it(lag: float, deviation: float) -> None:
    # Its logarithm is the state. Known to 30 %, sensors without lag made scale and temperature wrong in its place.
    known = ErrorPriors().with_calibration(calibration(temperature_sensor_lag=lag))
    assert known.lag_spread * known.lag == pytest.approx(deviation, rel=0.01)


def test_sensors_with_a_dead_time_are_unknown_only_while_they_fall_behind() -> None:
    # With a lag of first order in the place of a dead time, a pad on all taxels was wrong by 10 %, and valid.
    lag = 1.0
    priors = ErrorPriors().with_calibration(
        calibration(temperature_sensor_lag=lag, temperature_sensor_dead_time=0.75 * lag)
    )
    assert priors.dead_share == pytest.approx(0.75)
    model, rate, warming = SharedDynamics(priors, 0.06), 0.02, 0.013
    steady = state(lag)
    steady[Shared.RATE], steady[Shared.SENSOR] = rate, steady[Shared.CHIP] - lag * (rate + warming)
    begun = steady.copy()
    begun[Shared.SENSOR] = begun[Shared.CHIP]
    gained = [
        float(model.transition(each, BLOCK, warming)[2][Shared.SENSOR, Shared.SENSOR]) for each in (steady, begun)
    ]
    assert gained[0] == pytest.approx(0.0, abs=1e-15)
    assert gained[1] == pytest.approx((0.75 * (rate + warming)) ** 2 * BLOCK * lag, rel=1e-9)


def test_readings_are_as_noisy_as_a_calibration_has_found_them_or_as_assumed() -> None:
    priors = ErrorPriors()
    assert priors.with_calibration(calibration(temperature_reading_deviation=0.02)).reading == 0.02
    assert priors.with_calibration(calibration(temperature_reading_deviation=1e-3)).reading == priors.reading


def test_in_ten_minutes_a_constant_state_forgets_as_much_as_was_unknown_at_the_start() -> None:
    priors = ErrorPriors()
    gained = np.diag(dynamics().transition(state(), SharedDynamics.FORGET)[2])
    for constant in (Shared.LAG, Shared.SCALE, Shared.BEND, Shared.LEAK, Shared.WARMTH, Shared.CREEP):
        assert gained[constant] == pytest.approx(start_covariance(priors)[constant, constant], rel=1e-12)


def calibration(**found: Any) -> Calibration:
    """Return a calibration that determined what is given, and gains and time constants."""
    return replace(
        Calibration.nominal(load_sensor()), residuals=Residuals(1e-3, 1e-2, 1000), date="2026-01-01", **found
    )


def test_priors_have_a_value_for_every_state() -> None:
    priors = ErrorPriors()
    assert len(priors.creep) == len(priors.creep_mean) == len(priors.creep_times) == CREEPS
    assert start_covariance(priors).shape == (COUNT, COUNT)
    assert start_mean(priors).shape == (COUNT,)
    assert (np.diag(start_covariance(priors)) > 0.0).all()


def test_without_a_calibration_the_priors_stay() -> None:
    priors = ErrorPriors()
    assert priors.with_calibration(Calibration.nominal(load_sensor())) == priors


def test_a_calibration_makes_no_prior_less_certain() -> None:
    priors = ErrorPriors()
    known = priors.with_calibration(calibration(warmth=0.02, warmth_deviation=0.004))
    assert (start_covariance(known) <= start_covariance(priors)).all()
    assert known.leak < priors.leak
    assert known.pyroelectric < priors.pyroelectric


def test_the_saturation_of_a_warmth_that_a_calibration_found_is_expected() -> None:
    priors = ErrorPriors()
    observed = calibration(warmth=0.02, warmth_deviation=0.004, warmth_force=0.012, warmth_steepness=4.0)
    known = priors.with_calibration(observed)
    assert (known.warmth_force, known.warmth_steepness) == (0.012, 4.0)
    assert known.warmth_certain == 1.0
    assert 1.0 < known.warmth_force_spread < priors.warmth_force_spread


def test_the_saturation_of_nothing_is_not() -> None:
    priors = ErrorPriors()
    known = priors.with_calibration(calibration(warmth=1e-4, warmth_deviation=0.003, warmth_force=0.012))
    names = ("warmth_force", "warmth_certain", "warmth_force_spread")
    assert [getattr(known, name) for name in names] == [getattr(priors, name) for name in names]


def test_a_deviation_of_the_warmth_that_was_raised_in_the_file_counts_whatever_the_level_is() -> None:
    wide = {"warmth_deviation": 0.1, "warmth_force": 0.012, "warmth_steepness": 4.0}
    known = ErrorPriors().with_calibration(calibration(warmth=0.02, **wide))
    assert known.warmth == pytest.approx(0.1, rel=1e-2)
    assert (known.warmth_force, known.warmth_steepness, known.warmth_certain) == (0.012, 4.0, 1.0)
    assert ErrorPriors().with_calibration(calibration(warmth=0.0, **wide)).warmth == 0.1
    none = ErrorPriors(warmth=1e-6)
    assert none.with_calibration(calibration(warmth=0.0)).warmth == none.warmth, "what nobody has stated"


def test_slow_responses_that_a_calibration_found_replace_the_assumed_ones() -> None:
    priors = ErrorPriors()
    known = priors.with_calibration(
        calibration(
            relaxation_time_constants=np.array([0.5]),
            relaxation_sizes=np.array([0.03]),
            relaxation_deviations=np.array([0.001]),
        )
    )
    assert known.creep_times == (0.5, *priors.creep_times[1:])
    assert start_mean(known)[Shared.CREEP] == 0.03
    assert not start_mean(known)[Shared.CREEP + 1 :].any()
    # Stated by the calibration, but a film ages.
    assert priors.creep_least <= known.creep[0] < priors.creep[0]
    assert known.creep[1:] == priors.creep[1:]


def test_bending_that_a_calibration_found_is_expected_and_may_have_changed() -> None:
    priors = ErrorPriors()
    sizes = np.array([8e-3, -1e-3, 0.5e-3, 2e-3])
    found = calibration(bending=sizes, bending_deviation=np.full(BENDS, 1e-5), bending_profile=np.array([0.7, 1.3]))
    known = priors.with_calibration(found)
    assert known.bend_profile == (0.7, 1.3)
    bends = slice(Shared.BEND, Shared.BEND + BENDS)
    np.testing.assert_array_equal(start_mean(known)[bends], sizes)
    assert list(Shared)[bends] == [Shared.BEND, Shared.BEND_X, Shared.BEND_Y, Shared.BEND_MOMENT]
    # A chip is mounted otherwise on its calibration rig.
    expected = np.sqrt(np.square(priors.bend_mounted) + (priors.bend_share * 8e-3) ** 2 + 1e-10)
    np.testing.assert_allclose(np.sqrt(np.diag(start_covariance(known))[bends]), expected, rtol=1e-12)
    assert known.bend[0] < 0.5 * sizes[0]


def test_hysteresis_that_a_calibration_found_is_subtracted() -> None:
    widths, weights = np.array([0.02, 0.08, 0.3]), np.array([-0.01, -0.02, -0.03])
    found = calibration(hysteresis_half_widths=widths, hysteresis_weights=weights, hysteresis_slope=-0.02)
    known = ErrorPriors().with_calibration(found)
    assert (known.loop_half_widths, known.loop_weights) == (tuple(widths), tuple(weights))
    assert known.loop_slope == -0.02
    without = ErrorPriors().with_calibration(calibration())
    assert without.loop_weights == (0.0, 0.0, 0.0)
    assert without.loop_slope == 0.0


def test_what_an_object_warms_the_chip_by_is_expected_as_calibrated() -> None:
    priors, times, sizes = ErrorPriors(), np.array([1.0, 3.0, 10.0]), np.array([0.0, 0.03, 0.02])
    known = priors.with_calibration(calibration(chip_warming_time_constants=times, chip_warming=sizes))
    assert (known.chip_times, known.chip_warming) == (tuple(times), tuple(sizes))
    assert known.touch_rate == priors.touch_rate_calibrated
    none = priors.with_calibration(calibration(chip_warming_time_constants=times, chip_warming=np.zeros(3)))
    assert none.touch_rate == priors.touch_rate_calibrated
    assert priors.with_calibration(calibration()).touch_rate == priors.touch_rate  # a file that does not say


def test_more_slow_responses_than_states_are_left_out() -> None:
    many = np.linspace(0.1, 20.0, CREEPS + 2)
    known = ErrorPriors().with_calibration(
        calibration(relaxation_time_constants=many, relaxation_sizes=0.01 * many, relaxation_deviations=0.001 * many)
    )
    assert known.creep_times == tuple(many[:CREEPS])
    assert start_mean(known).shape == (COUNT,)
