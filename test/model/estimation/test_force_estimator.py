# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Static force by the filter of all force errors: accuracy, consistency, onset of a touch, start and validity."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.estimation.error_states import COUNT, ErrorPriors, Shared
from posfet_model.estimation.force_estimator import BLOCK, LAG, RESUME_TIME, ForceEstimator
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import InverseSignalChain, force_noise_rms
from reference.dense_pressure import sphere_forces
from reference.estimation import force_estimator as plain_estimator
from support.scan_player import Forces, nothing, press, scans

SENSOR = load_sensor()
TAXELS = SENSOR.layout.taxels
MIDDLE = TAXELS // 2
THRESHOLD = SENSOR.contact.threshold
SIDE = SENSOR.layout.cols


def patch() -> Forces:
    """Return the share of each taxel in a press on the 3 x 3 taxels in the middle."""
    shape = np.zeros((SIDE, SIDE))
    middle = SIDE // 2
    shape[middle - 1 : middle + 2, middle - 1 : middle + 2] = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 16
    return shape.ravel()


PATCH = patch()
PRESSED = PATCH > 0.0
FINGERTIP = sphere_forces(
    0.3e-3, -0.2e-3, 0.2, 5e-3, 1e6, SENSOR.device.contact_spread, SENSOR.layout.pitch_x, SENSOR.layout.rows
)
"""Forces of a fingertip of 0.2 N: the elastomer skin lets every taxel feel something, unlike the patch."""


CORNER = TAXELS - 1
STEP = round(1e-3 * (2**SENSOR.adc.bits - 1) / (SENSOR.adc.high - SENSOR.adc.low))
"""1 mV in counts."""


class Watch:
    """An estimator with scans as input; a taxel counts as touched while its force is known and above the threshold."""

    def __init__(self, model: Sensor = SENSOR, **options: Any) -> None:
        self.estimator = ForceEstimator(model, **options)
        self.valid: list[bool] = []
        self._inverse = InverseSignalChain(model)
        self._charge = np.zeros(TAXELS)
        self._touched, self._above = np.zeros(TAXELS, np.bool_), np.zeros(TAXELS, np.bool_)
        self._limit = np.full(TAXELS, THRESHOLD)
        self._last = -1e-3

    def process(self, time: float, scan: Any) -> NDArray[np.float64]:
        estimator, integration = self.estimator, self.estimator.integration
        charge = self._inverse.charge(scan.counts, self._charge)
        if not integration.process(charge, scan.temperatures, time - self._last):
            estimator.start(charge)
        self._last = time
        integration.compensate_common_mode(np.count_nonzero(self._touched) > 0)
        force = estimator.force
        np.greater(force, self._limit, out=self._above)
        np.logical_or(self._touched, self._above, out=self._touched)
        if estimator.block_time >= BLOCK:
            touched = self._touched & estimator.offset_known
            estimator.close_block(touched, [np.flatnonzero(touched)] if touched.any() else [])
            self._limit = np.maximum(THRESHOLD, 2.5 * np.sqrt(estimator.variance(np.empty(TAXELS))))
            self._touched = estimator.force > self._limit
        self.valid.append(estimator.valid)
        return estimator.force

    def deviation(self) -> NDArray[np.float64]:
        shared = self.estimator.correlated_error
        return np.sqrt(self.estimator.force_variance(np.empty(TAXELS)) + np.einsum("ij,ij->i", shared, shared))

    def total_deviation(self) -> float:
        """Return the standard uncertainty of the total force [N]."""
        shared = self.estimator.correlated_error.sum(axis=0)
        return math.sqrt(self.estimator.force_variance(np.empty(TAXELS)).sum() + float(shared @ shared))


def history(watch: Watch, device: Sensor, duration: float, **scene: Any) -> NDArray[np.float64]:
    """Return the forces of all taxels at every scan."""
    return np.array([watch.process(time, scan).copy() for time, scan in scans(device, duration, **scene)])


def with_device(**changes: float) -> Sensor:
    return replace(SENSOR, device=replace(SENSOR.device, **changes))


def test_two_newton_held_for_20_s_stay_within_the_uncertainty_and_1_percent() -> None:
    watch = Watch()
    forces = history(watch, SENSOR, 21.0, force=press(2.0, 1.0, 60.0), shape=PATCH)
    totals = forces[1100:].sum(axis=1)
    assert np.abs(totals - 2.0).max() < 0.02
    assert abs(totals[-1] - 2.0) < 2.0 * watch.total_deviation()
    # The signal itself has decayed by e^-74.
    assert watch.total_deviation() > 3.0 * force_noise_rms(SENSOR)
    assert all(watch.valid[300:])


@pytest.mark.parametrize("error", [-4e-3, 4e-3])
def test_the_error_of_the_first_temperature_reading_is_no_warming_of_the_film(error: float) -> None:
    """All later readings differ from it by the same; a rate of 2 mK/s made an error of 0.29 N within eight seconds."""
    watch, force, errors = Watch(), press(2.0, 2.0, 60.0), []
    for time, scan in scans(SENSOR, 10.0, force=force, shape=np.full(TAXELS, 1.0 / TAXELS)):
        scan.temperatures[:] = 25.0 + (error if time < 0.05 else 0.0)
        errors.append(abs(watch.process(time, scan).sum() - force(time)))
    assert max(errors[-100:]) < 0.2


def test_a_hold_that_fluctuates_is_not_valid_once_its_deviation_passes_the_limit() -> None:
    # Until the end of the next block the force falls by 0.9 %, and its noise is 0.1 %; within 0.16 s it falls by 4.8 %.
    limit, watch, beyond, seen = 0.16, Watch(max_relative_uncertainty=0.16), [], set()

    def force(time: float) -> float:
        return float(np.clip((time - 1.0) / 0.1, 0.0, 1.0)) * (2.0 + 0.1 * math.sin(6.0 * time))

    for time, scan in scans(SENSOR, 20.0, force=force, shape=PATCH):
        total = float(watch.process(time, scan).sum())
        if time > 1.5:
            seen.add(watch.valid[-1])
            beyond.append(watch.valid[-1] and watch.total_deviation() > limit * total)
    assert seen == {False, True}
    assert not any(beyond)


def test_the_uncertainty_grows_while_held_and_recovers_after_the_release() -> None:
    watch, seen = Watch(), {}
    for time, scan in scans(SENSOR, 6.0, force=press(1.0, 1.0, 5.0), shape=PATCH):
        watch.process(time, scan)
        seen[round(time, 3)] = float(watch.deviation()[MIDDLE])
    assert seen[0.9] < seen[2.0] < seen[3.0] < seen[4.9]
    assert seen[5.9] < 0.2 * seen[4.9]


@pytest.mark.parametrize(
    "error",
    [
        {},
        {"leak_time_constant": 1.05 * SENSOR.device.leak_time_constant},
        {"leak_time_constant": 0.95 * SENSOR.device.leak_time_constant},
    ],
    ids=["exact", "leaks less", "leaks more"],
)
def test_the_two_sigma_interval_covers_a_held_force_95_percent_of_the_time(error: dict[str, float]) -> None:
    # A leak rate that differs by half a standard deviation is within what the model admits.
    device = with_device(**error)
    inside, totals = [], []
    for seed in range(2):
        watch = Watch()
        force = press(2.0, 1.0, 60.0)
        for time, scan in scans(device, 5.0, force=force, shape=PATCH, seed=seed):
            estimate = watch.process(time, scan)
            if time > 1.1 and round(time * 1000) % 100 == 0:
                truth = force(time) * PATCH
                inside.extend(np.abs(estimate - truth) <= 2.0 * watch.deviation())
                totals.append(abs(float(estimate.sum()) - 2.0) <= 2.0 * watch.total_deviation())
    assert len(inside) >= 1900
    assert np.mean(inside) >= 0.95
    assert np.mean(totals) >= 0.95


@pytest.mark.parametrize("rise", [0.02, 0.1, 0.25])
def test_the_onset_of_a_touch_is_not_absorbed(rise: float) -> None:
    # Blocks of the last 0.3 s are processed again without the touched taxels: what they took is given back. Measured:
    # +0.6 to +1.0 %.
    watch = Watch()
    forces = history(watch, SENSOR, 1.5 + rise, force=press(1.0, 1.0, 60.0, rise=rise), shape=FINGERTIP)
    held = forces[-50:].sum(axis=1).mean()
    assert abs(held - 0.2) <= 2.0 * watch.total_deviation()
    assert held == pytest.approx(0.2, rel=0.03)


@pytest.mark.parametrize("rise", [1.0, 3.0])
@pytest.mark.parametrize("seed", range(2))
def test_what_a_slow_press_may_have_lost_is_in_the_uncertainty(rise: float, seed: int) -> None:
    # Measured for six seeds: 13 to 15 % are lost at a rise of 1 s, 9 to 21 % at 3 s.
    watch = Watch()
    force = press(0.2, 1.0, 60.0, rise=rise)
    forces = history(watch, SENSOR, 1.5 + rise, force=force, shape=PATCH, seed=seed)
    assert abs(forces[-50:].sum(axis=1).mean() - 0.2) <= 2.0 * watch.total_deviation()


@pytest.mark.parametrize("offset", [-0.15, -0.02, 0.005, 0.05, 0.15])
def test_any_amplifier_offset_is_estimated(offset: float) -> None:
    device = replace(SENSOR, amplifier=replace(SENSOR.amplifier, offset=offset))
    watch = Watch()
    forces = history(watch, device, 3.0, force=press(2.0, 1.0, 2.5), shape=PATCH)
    assert watch.estimator.valid
    assert np.abs(forces[500:1000]).max() < 5e-3
    np.testing.assert_allclose(forces[1100:2500].sum(axis=1), 2.0, rtol=0, atol=0.04)
    assert np.abs(forces[2900:]).max() < 5e-3


def test_an_offset_does_not_look_like_a_temperature_at_the_start() -> None:
    # Force errors belong to the middle of a block. Half a block of leakage at 0.15 V would be 6 mK of the film.
    device = replace(SENSOR, amplifier=replace(SENSOR.amplifier, offset=0.15))
    watch = Watch()
    history(watch, device, 0.07)
    assert abs(watch.estimator.belief.shared[Shared.FILM]) < 2e-3


def test_a_load_held_from_the_start_ends_with_a_correct_baseline() -> None:
    watch = Watch()
    forces = history(watch, SENSOR, 4.0, force=press(2.0, -1.0, 1.0), shape=PATCH)
    assert watch.estimator.valid
    assert np.abs(forces[3900:]).max() < 5e-3
    assert watch.total_deviation() < 0.01  # it is no slow press that ended


def test_a_varying_load_at_the_start_does_not_corrupt_later_forces() -> None:
    def wild(time: float) -> float:
        return 1.0 + 0.5 * math.sin(9.0 * time) if time < 2.0 else press(2.0, 4.0, 5.0)(time)

    watch = Watch()
    forces = history(watch, SENSOR, 6.0, force=wild, shape=PATCH)
    assert not any(watch.valid[:2000])
    assert all(watch.valid[3300:])
    np.testing.assert_allclose(forces[4100:5000].sum(axis=1), 2.0, rtol=0, atol=0.02)
    assert np.abs(forces[-1]).max() < 5e-3


@pytest.mark.parametrize("gap", [2, 50, 300])
def test_a_held_force_is_tracked_across_missing_scans(gap: int) -> None:
    watch = Watch()
    for time, scan in scans(SENSOR, 3.0, force=press(2.0, 1.0, 60.0), shape=PATCH):
        if not 1.5 <= time < 1.5 + gap * 1e-3:
            watch.process(time, scan)
    assert watch.estimator.force.sum() == pytest.approx(2.0, abs=0.02)


def test_a_release_within_a_gap_is_detected_and_adds_uncertainty() -> None:
    watch, after = Watch(), []
    for time, scan in scans(SENSOR, 3.0, force=press(2.0, 1.0, 1.52), shape=PATCH):
        if not 1.5 <= time < 1.7:
            force = watch.process(time, scan)
            if 1.7 <= time < 1.701:
                after.append((float(force.sum()), watch.total_deviation()))
    [(left, deviation)] = after
    assert abs(left) < 3.0 * deviation
    assert deviation > 0.1
    assert np.abs(watch.estimator.force).max() < 5e-3


def test_a_touch_that_began_within_a_gap_keeps_its_uncertainty() -> None:
    watch, errors = Watch(), []
    for time, scan in scans(SENSOR, 3.0, force=press(2.0, 1.02, 60.0), shape=PATCH):
        if not 1.0 <= time < 1.2:
            force = watch.process(time, scan)
            if time >= 1.2:
                errors.append((abs(float(force.sum()) - 2.0), watch.total_deviation()))
    assert all(error < 3.0 * deviation for error, deviation in errors)
    assert max(error for error, _ in errors) > 0.1, "the gap caused no error, so nothing is tested"


@pytest.mark.parametrize("rate", [-0.1, 0.0, 0.1])
def test_an_array_at_rest_reads_zero_within_its_uncertainty_at_any_constant_temperature_rate(rate: float) -> None:
    watch = Watch()
    inside = []
    for time, scan in scans(SENSOR, 5.0, temperature=lambda time: 25.0 + rate * time):
        force = watch.process(time, scan)
        if time > 2.0 and round(time * 1000) % 100 == 0:
            inside.extend(np.abs(force) <= 2.0 * watch.deviation())
    # 95.4 % of a normal distribution; 725 values, not independent, have a standard error of 0.8 % at least.
    assert np.mean(inside) >= 0.93
    assert np.abs(watch.estimator.force).max() < 0.25 * THRESHOLD


def test_a_force_held_while_the_chip_warms_is_within_its_uncertainty() -> None:
    watch = Watch()
    force = press(2.0, 4.0, 60.0)
    totals = []
    for time, scan in scans(SENSOR, 9.0, force=force, shape=PATCH, temperature=lambda time: 25.0 + 0.05 * time):
        estimate = watch.process(time, scan)
        if time > 4.1 and round(time * 1000) % 100 == 0:
            totals.append(abs(float(estimate[PRESSED].sum()) - 2.0) <= 2.0 * watch.total_deviation())
    # 0.25 K at about 1 N/K are 2.4 N on the nine taxels, of which the untouched ones determine nearly all.
    assert np.mean(totals) >= 0.95


def test_the_forces_are_valid_up_to_the_relative_uncertainty_that_is_asked_for() -> None:
    def held(limit: float) -> list[bool]:
        watch = Watch(max_relative_uncertainty=limit)
        history(watch, SENSOR, 3.0, force=press(2.0, 1.0, 60.0), shape=PATCH)
        return watch.valid[1500:]

    assert all(held(0.2))
    assert not any(held(1e-3))


@pytest.mark.parametrize("seed", range(3))
def test_a_touch_since_before_the_start_is_not_valid_until_its_release_and_leaves_no_force(seed: int) -> None:
    def one(time: float) -> float:
        return 1.0 - press(1.0, 2.0, 60.0, rise=0.2)(time) + press(1.0, 4.0, 60.0, rise=0.2)(time)

    watch, errors, deviations = Watch(), [], []
    watch.estimator.touch_at_start = True
    for time, scan in scans(SENSOR, 4.6, force=one, shape=PATCH, rate=500.0, seed=seed):
        errors.append(watch.process(time, scan).sum() - one(time))
        deviations.append(watch.total_deviation())
    assert not any(watch.valid[:1050])
    assert all(watch.valid[1400:1900])
    assert np.abs(errors[1400:1900]).max() < 0.05
    assert max(deviations[1400:1900]) < 0.02
    assert np.abs(errors[2200:]).max() < 0.1


def test_what_no_force_is_must_be_shown_again_by_a_filter_that_diverged() -> None:
    watch = Watch()
    watch.estimator.touch_at_start = True
    stream = scans(SENSOR, 4.0)
    for time, scan in islice(stream, 1000):
        watch.process(time, scan)
    watch.estimator.tare(forced=True)
    for time, scan in islice(stream, 1000):
        watch.process(time, scan)
    assert watch.valid[-1]
    watch.estimator.belief.own[:, 0, 0] = math.nan
    for time, scan in stream:
        watch.process(time, scan)
    assert not any(watch.valid[2020:])


@pytest.mark.parametrize("hold", [1.0, 3.0])
def test_what_a_hot_object_hides_is_not_valid_and_leaves_no_force(hold: float) -> None:
    """Its warmth is twice its force: below zero, it counted as released; and its warmth, as it left, as a touch."""

    def warmth(time: float) -> float:
        warm = 1.0 - math.exp(-min(max(time - 1.0, 0.0), hold) / 0.5)
        return 2.0 * warm * math.exp(-max(time - 1.0 - hold, 0.0) / 0.5)

    def cool(time: float) -> float:
        return press(1.0, hold + 6.0, hold + 8.5)(time) + press(1.0, hold + 9.5, 60.0)(time)

    def force(time: float) -> float:
        return press(1.0, 1.0, 1.0 + hold)(time) - warmth(time) + cool(time)

    watch = Watch()
    totals = history(watch, SENSOR, hold + 10.5, force=force, shape=PATCH).sum(axis=1)
    valid, end = np.array(watch.valid), round(1000 * (1.0 + hold))
    assert not valid[1500 : end + 500].any()
    assert np.abs(totals[end + 3500 : end + 4900]).max() < 0.1
    assert valid[end + 4000 : end + 4900].all()
    assert not valid[end + 5100 : end + 7400].any(), "what comes next may be as hot"
    assert valid[end + 8600 :].all(), "it was not"


def test_what_its_warmth_hides_has_not_left_however_long_it_stays() -> None:
    """On a board of known warmth: its force was zero after two seconds, valid, and 1.5 N were left for good."""
    begin, end = 1.0, 6.0

    def force(time: float) -> float:
        warm = 1.0 - math.exp(-min(max(time - begin, 0.0), end - begin) / 0.5)
        return press(0.4, begin, end)(time) - warm * math.exp(-max(time - end, 0.0) / 0.5)

    watch = Watch(priors=replace(ErrorPriors(), warmth_mean=0.1))
    totals = history(watch, SENSOR, end + 5.0, force=force, shape=PATCH).sum(axis=1)
    assert not any(watch.valid[1500 : round(1000 * end) + 500])
    assert np.abs(totals[round(1000 * end) + 2500 :]).max() < 0.02
    assert all(watch.valid[round(1000 * end) + 2500 :])


def test_a_force_of_which_warmth_leaves_nothing_is_not_valid_as_none() -> None:
    """It reads zero for ever, and was valid two seconds after it had begun."""
    begin, end = 1.0, 6.0

    def force(time: float) -> float:
        warm = 1.0 - math.exp(-min(max(time - begin, 0.0), end - begin) / 0.5)
        return press(0.4, begin, end)(time) - 0.4 * warm * math.exp(-max(time - end, 0.0) / 0.5)

    watch = Watch(priors=replace(ErrorPriors(), warmth_mean=0.1))
    totals = history(watch, SENSOR, end + 5.0, force=force, shape=PATCH).sum(axis=1)
    assert not any(watch.valid[1500:]), "nothing has shown that it left"
    assert np.abs(totals[round(1000 * end) + 2500 :]).max() < 0.02


def test_a_slow_press_whose_warmth_hides_more_than_it_is_not_valid_and_leaves_no_force() -> None:
    """It reads less than none, and zeros absorbed it; as it left, the film that cooled was a press for good."""
    begin, end = 6.0, 14.0

    def force(time: float) -> float:
        share = min(max((time - begin) / 4.0, 0.0), 1.0)
        warm = 0.35 * share * math.exp(-max(time - end, 0.0) / 0.5)
        return (0.15 * share if time < end else 0.0) - warm

    watch = Watch(priors=replace(ErrorPriors(), warmth_mean=0.1))
    totals = history(watch, SENSOR, end + 5.0, force=force, shape=PATCH).sum(axis=1)
    assert all(watch.valid[1000 : round(1000 * begin)])
    assert not any(watch.valid[round(1000 * begin) + 2500 : round(1000 * end) + 500])
    assert np.abs(totals[round(1000 * end) + 3000 :]).max() < 0.05


def test_what_a_hot_object_does_to_the_whole_film_is_no_warming_since_before_the_start() -> None:
    watch = Watch()
    hot = [-2.0 * (1.0 - math.exp(-max(0.001 * index - 3.0, 0.0) / 0.5)) for index in range(6001)]
    history(watch, SENSOR, 6.0, force=lambda time: hot[round(1000 * time)], shape=np.full(TAXELS, 1.0 / TAXELS))
    assert abs(watch.estimator.belief.shared[Shared.EARLIER]) < 5e-3  # 0.1 K/s before


def test_a_forced_tare_says_that_nothing_touches() -> None:
    watch = Watch()
    watch.estimator.touch_at_start = True
    for time, scan in scans(SENSOR, 1.5):
        watch.process(time, scan)
        if round(1000 * time) == 1000:
            watch.estimator.tare(True)
    assert not any(watch.valid[:1000])
    assert all(watch.valid[1050:])


def test_the_relative_uncertainty_does_not_matter_at_rest() -> None:
    watch = Watch(max_relative_uncertainty=1e-3)
    history(watch, SENSOR, 1.5)
    assert all(watch.valid[500:])


def test_a_tare_sets_the_forces_to_zero_and_keeps_the_offsets() -> None:
    watch = Watch()
    history(watch, SENSOR, 1.0)
    before = watch.estimator.force.copy()
    change = watch.estimator.tare()
    np.testing.assert_allclose(watch.estimator.force, before + change, rtol=0, atol=1e-15)
    assert watch.estimator.offset_known.all()
    assert np.abs(watch.estimator.force).max() < 5.0 * force_noise_rms(SENSOR)


def test_a_forced_tare_under_load_reads_changes_from_then_on() -> None:
    watch, rows = Watch(), []
    for time, scan in scans(SENSOR, 3.0, force=press(1.0, 1.0, 2.0), shape=PATCH):
        rows.append(watch.process(time, scan).copy())
        if round(time * 1000) == 1500:
            watch.estimator.tare(forced=True)
    # The load is released from 2.0 s on: minus 1 N at first, and zero soon after, as no object pulls.
    assert np.abs(rows[1510]).max() < 0.01
    assert rows[2050].sum() == pytest.approx(-1.0, abs=0.1)
    assert np.abs(rows[-1]).max() < 0.01


def test_after_an_interruption_the_force_is_the_remaining_charge_and_not_valid_at_once() -> None:
    watch = Watch()
    for time, scan in scans(SENSOR, 2.0, force=press(1.0, 1.0, 60.0), shape=PATCH):
        if round(time * 1000) == 1200:
            remaining = watch.estimator.residual_charge.copy()
            watch.estimator.interrupt()
            assert not watch.estimator.valid
        force = watch.process(time, scan)
        if round(time * 1000) == 1200:
            # One step of leakage and its noise.
            np.testing.assert_allclose(force, remaining, rtol=0, atol=0.01 * remaining.max())
    assert watch.estimator.offset_known.all()
    assert not any(watch.valid[1200 : 1200 + round(RESUME_TIME * 1000)])
    # The force is a lower bound until it is released.
    assert not watch.estimator.valid


def test_what_is_forgotten_leaves_nothing() -> None:
    fresh, used = Watch(), Watch()
    history(used, SENSOR, 1.0, force=lambda time: 0.5 * math.sin(40.0 * time), shape=PATCH)
    assert used.estimator.restarts > 0, "offsets were rejected"
    used.estimator.forget()
    used.valid.clear()
    used._last, used._touched[:], used._limit[:] = -1e-3, False, THRESHOLD
    for each in (fresh, used):
        history(each, SENSOR, 0.03)
    offset = [each.estimator.belief.own[:, 1, 1] for each in (used, fresh)]
    np.testing.assert_allclose(*offset, rtol=0.05)
    for each in (fresh, used):
        each._last -= 0.03
    rows = [history(each, SENSOR, 1.0) for each in (fresh, used)]
    assert used.valid == fresh.valid
    np.testing.assert_allclose(rows[1][200:], rows[0][200:], rtol=0, atol=force_noise_rms(SENSOR))
    np.testing.assert_allclose(*(each.estimator.variance(np.empty(TAXELS)) for each in (used, fresh)), rtol=0.05)


def test_an_interruption_at_rest_leaves_forces_valid_soon_after() -> None:
    watch = Watch()
    for time, scan in scans(SENSOR, 2.0):
        if round(time * 1000) == 1200:
            watch.estimator.interrupt()
        watch.process(time, scan)
    assert all(watch.valid[1200 + round((RESUME_TIME + 2 * BLOCK) * 1000) :])


def test_an_ignored_taxel_does_not_affect_the_others() -> None:
    broken = np.zeros(TAXELS, np.bool_)
    broken[0] = True
    alone, beside = Watch(), Watch()
    for each in (alone, beside):
        each.estimator.ignore(broken)
    scene: dict[str, Any] = {"force": press(1.0, 1.0, 60.0), "shape": PATCH}
    reference = history(alone, SENSOR, 2.5, **scene)
    rows = []
    random = np.random.default_rng(1)
    for time, scan in scans(SENSOR, 2.5, **scene):
        scan.counts[0] = random.integers(0, 4095)
        rows.append(beside.process(time, scan).copy())
    assert beside.estimator.valid
    # A taxel of the corner is two taxels away from the press: its noise is no contact.
    np.testing.assert_allclose(np.array(rows)[1500:, PRESSED], reference[1500:, PRESSED], rtol=0, atol=5e-3)


def test_a_saturated_taxel_becomes_less_certain_by_what_may_have_leaked() -> None:
    watch = Watch()
    force = press(1.0, 1.0, 60.0)
    one = np.zeros(TAXELS, np.bool_)
    one[MIDDLE] = True
    for time, scan in scans(SENSOR, 1.5, force=force, shape=PATCH):
        watch.process(time, scan)
        if round(time * 1000) == 1200:
            before, signal = watch.deviation(), watch.estimator.residual_charge[MIDDLE]
            for _ in range(100):
                watch.estimator.integration.clip(one, 1e-3)
        if round(time * 1000) == 1200 + 2 * round(BLOCK * 1000):
            after = watch.deviation()
    lost = 0.1 * signal / SENSOR.device.leak_time_constant
    assert after[MIDDLE] >= math.hypot(before[MIDDLE], 0.9 * lost)
    assert after[MIDDLE + 1] < 1.1 * before[MIDDLE + 1] + 1e-3


def test_what_leaked_unseen_as_a_touch_began_counts_though_its_blocks_are_processed_again() -> None:
    def hit(clipped: bool) -> tuple[NDArray[np.float64], float]:
        watch, lost = Watch(), 0.0
        one = np.arange(TAXELS) == MIDDLE
        for time, scan in scans(SENSOR, 1.2, force=press(1.0, 1.0, 60.0), shape=PATCH):
            watch.process(time, scan)
            if 1000 < round(time * 1000) <= 1020 and clipped:
                lost += 5.0 * watch.estimator.residual_charge[MIDDLE] * 1e-3 / SENSOR.device.leak_time_constant
                watch.estimator.integration.clip(one, 5e-3)
            if round(time * 1000) == 990:
                before = watch.estimator.processed_again
            if round(time * 1000) == 1060:
                assert watch.estimator.processed_again > before
                return watch.deviation(), lost
        raise AssertionError("no such scan")

    (with_it, lost), (without, _) = hit(True), hit(False)
    assert lost > 0.01
    assert with_it[MIDDLE] >= math.hypot(without[MIDDLE], 0.9 * lost)


def test_a_whole_array_that_is_pressed_is_valid_whatever_a_taxel_was_before() -> None:
    watch = Watch()
    for time, scan in scans(SENSOR, 2.0, force=press(20.0, 1.0, 60.0, rise=0.001), shape=np.full(TAXELS, 1 / TAXELS)):
        if 0.98 <= time < 1.0:
            scan.counts[CORNER] -= 20 * STEP  # below zero, for a block
        watch.process(time, scan)
    assert all(watch.valid[1200:])


def test_the_variance_without_a_touch_is_the_whole_one_at_rest_and_a_part_of_it_during_a_touch() -> None:
    watch = Watch()
    history(watch, SENSOR, 1.0, force=nothing)
    slow_press = watch.estimator.correlated_error[:, COUNT + 2]  # would raise the thresholds of its own contact
    whole = watch.deviation() ** 2 - slow_press**2
    np.testing.assert_allclose(watch.estimator.variance(np.empty(TAXELS)), whole, rtol=0.02)
    watch = Watch()
    history(watch, SENSOR, 2.0, force=press(1.0, 1.0, 60.0), shape=PATCH)
    share = watch.estimator.variance(np.empty(TAXELS)) / watch.deviation() ** 2
    assert (share > 0.0).all()
    assert (share[PRESSED] < 0.1).all()


def test_gains_of_a_calibration_scale_the_forces() -> None:
    nominal = Calibration.nominal(SENSOR)
    watch = Watch(calibration=replace(nominal, gain=nominal.gain * 2.0))
    forces = history(watch, SENSOR, 2.0, force=press(2.0, 1.0, 60.0), shape=PATCH)
    assert forces[1500:].sum(axis=1).mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("name", ["gain_deviation", "leak_deviation"])
def test_what_a_calibration_leaves_unknown_is_in_the_uncertainty_of_each_taxel(name: str) -> None:
    nominal = Calibration.nominal(SENSOR)
    variances = []
    for deviation in (0.0, 0.2):
        watch = Watch(calibration=replace(nominal, **{name: np.full(TAXELS, deviation)}))
        history(watch, SENSOR, 3.0, force=press(2.0, 1.0, 60.0), shape=PATCH)
        variances.append(watch.estimator.force_variance(np.empty(TAXELS)))
    # After two seconds, seven time constants, the whole charge has leaked: both act in proportion to the force.
    expected = (0.2 * 2.0 * PATCH) ** 2
    np.testing.assert_allclose((variances[1] - variances[0])[PRESSED], expected[PRESSED], rtol=0.05)
    assert (variances[1] - variances[0])[~PRESSED].max() < 0.01 * expected.max()


@pytest.mark.parametrize("rate", [200.0, 1000.0, 3000.0])
def test_the_scan_rate_does_not_matter(rate: float) -> None:
    watch = Watch()
    forces = history(watch, SENSOR, 2.5, force=press(1.0, 1.0, 60.0), shape=PATCH, rate=rate)
    assert forces[-1].sum() == pytest.approx(1.0, abs=0.02)
    assert watch.estimator.valid


@pytest.mark.parametrize("rate", [10.0, 20.0, 50.0])
def test_the_rate_of_a_chip_that_changed_under_a_contact_is_no_press_that_zeros_have_hidden(rate: float) -> None:
    """What the rate was before the stored blocks is compared only once no contact is in any of them."""
    watch, cools = Watch(), 9.9
    watch._last = -1.0 / rate
    for time, scan in scans(
        SENSOR,
        10.0 + LAG * max(1.0 / rate, BLOCK),
        force=press(2.0, 5.0, 10.0),
        shape=PATCH,
        rate=rate,
        temperature=lambda time: 25.0 - max(0.0, time - cools),
    ):
        watch.process(time, scan)
        unnoticed = np.abs(watch.estimator.correlated_error[:, COUNT + 1]).max()
        assert time < 10.0 or unnoticed == 0.0, f"{time:.2f} s"


def test_the_temperature_sensors_are_not_needed_for_a_steady_chip() -> None:
    watch = Watch()
    rows = []
    force: Callable[[float], float] = press(1.0, 1.0, 3.0)
    for time, scan in scans(SENSOR, 4.0, force=force, shape=PATCH):
        scan.temperatures[:] = math.nan
        rows.append(watch.process(time, scan).copy())
    assert not watch.estimator.integration.thermometers.known
    assert np.array(rows)[1500:2900].sum(axis=1) == pytest.approx(1.0, abs=0.02)
    assert np.abs(rows[-1]).max() < 5e-3


def test_an_untouched_array_reads_zero_for_a_minute_without_restarts() -> None:
    watch = Watch()
    forces = history(watch, SENSOR, 60.0, force=nothing, rate=100.0)
    assert np.abs(forces[100:]).max() < 10.0 * force_noise_rms(SENSOR)
    assert watch.estimator.restarts == 0


def test_a_uniform_press_is_not_valid_until_the_sensors_told_it_from_a_warmer_film() -> None:
    watch, force = Watch(), press(2.5, 1.0, 9.0, rise=0.2)
    forces = history(watch, SENSOR, 3.5, force=force, shape=np.full(TAXELS, 1.0 / TAXELS))
    wrong = np.abs(forces.sum(axis=1) - np.array([force(0.001 * number) for number in range(3500)])) > 0.3
    assert np.count_nonzero(wrong[1100:2000]) > 800  # it cannot be known yet
    assert not any(np.array(watch.valid)[1100:] & wrong[1100:])
    assert forces[-1].sum() == pytest.approx(2.5, rel=0.02)


@pytest.mark.parametrize("begin", [0.9, *(pytest.param(begin, marks=pytest.mark.slow) for begin in (1.2, 1.5)), 1.95])
@pytest.mark.parametrize("rise", [0.05, 0.3])
@pytest.mark.parametrize(("warming", "silent"), [(0.1, (1.0, 2.0)), (0.0, (0.0, 9.0)), (0.1, (0.0, 9.0))])
def test_a_uniform_press_is_never_valid_as_no_force_while_the_sensors_are_silent(
    begin: float, rise: float, warming: float, silent: tuple[float, float]
) -> None:
    watch, force, wrong = Watch(), press(2.0, begin, 60.0, rise=rise), []
    uniform = np.full(TAXELS, 1.0 / TAXELS)
    for time, scan in scans(SENSOR, 5.0, force=force, shape=uniform, temperature=lambda time: 25.0 + warming * time):
        if silent[0] <= time < silent[1]:
            scan.temperatures[:] = math.nan
        error = abs(watch.process(time, scan).sum() - force(time))
        wrong.append(error > max(0.1 * force(time), 0.05))
    # Measured: 0 to 30 scans at the onset; a uniform press counted as a warmer film for good before.
    assert np.count_nonzero(np.array(wrong) & np.array(watch.valid)) <= 40


@pytest.mark.parametrize("rise", [4.0, 8.0])
def test_a_press_that_rises_on_all_taxels_within_seconds_is_no_colder_film(rise: float) -> None:
    """Each reading of the sensors contradicts zeros by next to nothing: it read nothing, valid, and for good."""
    sensors = replace(Calibration.nominal(SENSOR), residuals=Residuals(0.0, 0.0, 1), temperature_sensor_lag=0.1)
    watch, force, errors = Watch(calibration=sensors), press(1.0, 10.0, 14.0 + rise, rise=rise), []
    for time, scan in scans(SENSOR, 13.5 + rise, force=force, shape=np.full(TAXELS, 1.0 / TAXELS), rate=500.0):
        errors.append(watch.process(time, scan).sum() - force(time))
    assert np.abs(errors[-1750:]).max() < 0.05
    assert watch.total_deviation() < 0.5


def test_a_contact_with_the_whole_array_does_not_end_as_it_becomes_uncertain() -> None:
    watch, force, total = Watch(), press(2.0, 1.0, 6.0), []
    for time, scan in scans(SENSOR, 8.0, force=force, shape=np.full(TAXELS, 1.0 / TAXELS)):
        scan.temperatures[:] = math.nan
        total.append(watch.process(time, scan).sum())
        assert not watch.estimator.valid or abs(total[-1] - force(time)) < 0.3 or time < 1.02
    assert total[5900] == pytest.approx(2.0, abs=0.1)  # its deviation has exceeded the force for a second
    assert abs(total[-1]) < 0.02
    assert watch.estimator.valid


def test_a_tare_closes_an_undecided_hypothesis() -> None:
    watch = Watch()
    for time, scan in scans(SENSOR, 3.0, force=press(2.0, 1.2, 60.0), shape=np.full(TAXELS, 1.0 / TAXELS)):
        scan.temperatures[:] = 25.0 + 0.1 * time if time < 1.0 else math.nan
        watch.process(time, scan)
        if round(1000 * time) == 2000:
            assert not watch.estimator.valid
            watch.estimator.tare(forced=True)
        if round(1000 * time) > 2100:
            assert watch.estimator.valid
            assert abs(watch.estimator.force.sum()) < 0.1


@pytest.mark.parametrize("offset", [-0.15, 0.15])
def test_blocks_of_unequal_length_do_not_look_like_warming(offset: float) -> None:
    # Rounding of times makes some blocks one scan longer. The force error grows by 0.6 N/s: half a scan of it shows.
    device = replace(SENSOR, amplifier=replace(SENSOR.amplifier, offset=offset))
    watch, rates = Watch(), []
    for time, scan in scans(device, 1.2):
        watch.process(time, scan)
        if time > 0.5:
            rates.append(float(watch.estimator.belief.shared[Shared.RATE]))
    assert np.abs(rates).max() < 0.01


def test_a_drift_beside_a_contact_is_not_raised_by_the_warmth_that_it_seems_to_have() -> None:
    # The warmth of a weakly touched taxel is computed from its force, and raises that force, if it is subtracted from
    # the force but not from what is known to be small.
    def held(warmth: float) -> float:
        watch, rows = Watch(priors=replace(ErrorPriors(), warmth_mean=warmth)), []
        for time, scan in scans(SENSOR, 9.0, force=press(10.0, 1.0, 60.0), shape=FINGERTIP):
            scan.counts[CORNER] += STEP // 4 * (time > 2.0)
            rows.append(watch.process(time, scan)[CORNER])
        return float(np.mean(rows[-100:]))

    # Warmth of a force of 2 mN: 1 mK, and what it raises the force by. Measured: 2.0 mN, without the subtraction 3.9.
    assert held(0.03) - held(0.0) < 0.15 * THRESHOLD


def test_a_taxel_with_telegraph_noise_is_as_uncertain_as_that_makes_it() -> None:
    random, watch, high, errors = np.random.default_rng(3), Watch(), False, []
    for time, scan in scans(SENSOR, 20.0, force=press(10.0, 10.0, 60.0), shape=FINGERTIP):
        high ^= bool(random.random() < 1e-3)
        scan.counts[CORNER] += STEP * high
        force = watch.process(time, scan)
        if time > 11.0 and round(time * 1000) % 100 == 0:
            errors.append((force[CORNER] - 10.0 * FINGERTIP[CORNER]) / watch.deviation()[CORNER])
    assert np.mean(np.abs(errors) < 2.0) >= 0.9
    assert watch.deviation()[CORNER] > 2.0 * watch.deviation()[SIDE - 1]


def test_a_film_that_warms_is_no_noise_of_single_taxels() -> None:
    def variance(rate: float) -> NDArray[np.float64]:
        watch = Watch()
        history(watch, SENSOR, 5.0, temperature=lambda time: 25.0 + rate * min(max(time - 2.0, 0.0), 1.0))
        return watch.estimator.force_variance(np.empty(TAXELS))

    # After two seconds at rest nothing of the warming is left.
    np.testing.assert_allclose(variance(1.0), variance(0.0), rtol=0.1)


@pytest.mark.parametrize("rate", [-0.02, 0.02, 0.03])
def test_a_chip_that_warms_from_the_start_has_no_offset_for_that(rate: float) -> None:
    # Its film charges the gates. Taken for an offset, the charge would hide the warming from the force, and the sensors
    # would seem to be wrong: measured a scale of 1.33, and a film at a third of its temperature.
    watch = Watch()
    history(watch, SENSOR, 6.0, temperature=lambda time: 25.0 + rate * time)
    belief = watch.estimator.belief
    deviation = np.sqrt(np.diag(belief.covariance))
    assert abs(belief.shared[Shared.SCALE]) < 2.0 * deviation[Shared.SCALE]
    assert abs(belief.shared[Shared.FILM] - 6.0 * rate) < 3.0 * deviation[Shared.FILM]


@pytest.mark.parametrize("rate", [-0.5 / 60.0, 0.5 / 60.0, 2.0 / 60.0])
def test_a_chip_that_warmed_before_the_first_scan_does_not_count_twice(rate: float) -> None:
    # The constant charge of a constant rate looks like an offset; the sensors, which show the rate, like a fall of the
    # force: 2 N on all taxels grew by 0.3 N in each second, and were valid.
    watch, plain, forces, errors = Watch(), Watch(), [], []
    plain.estimator = plain_estimator.ForceEstimator(SENSOR)
    scene: dict[str, Any] = {"force": press(2.0, 7.0, 60.0), "shape": np.full(TAXELS, 1.0 / TAXELS)}
    for time, scan in scans(SENSOR, 12.0, temperature=lambda time: 25.0 + rate * time, **scene):
        if time >= 3.0:
            forces.append(watch.process(time - 3.0, scan).copy())
            errors.append(np.abs(plain.process(time - 3.0, scan) - forces[-1]).max())
    total = np.array(forces)[4200:].sum(axis=1)
    assert abs(total - 2.0).max() < min(0.3, 2.0 * watch.total_deviation())
    assert max(errors[1:]) < 1e-6  # the film in NumPy


@pytest.mark.parametrize("pyroelectric", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("rate", [-0.15, 0.3])
def test_a_chip_that_warms_fast_from_the_start_restarts_no_taxel(rate: float, pyroelectric: float) -> None:
    # The charge of the film grows for a second: no motion. Restarts on each change took its rate from noise.
    watch = Watch()
    device = with_device(pyroelectric_coefficient=pyroelectric * SENSOR.device.pyroelectric_coefficient)
    forces = history(watch, device, 2.0, temperature=lambda time: 25.0 + rate * time)
    assert watch.estimator.offset_known.all()
    assert np.abs(forces[1000:]).max() < 0.3 * THRESHOLD
    assert watch.estimator.belief.shared[Shared.FILM] == pytest.approx(2.0 * rate * pyroelectric, rel=0.25)


def test_a_taxel_whose_pyroelectric_response_differs_reads_zero_while_the_chip_warms() -> None:
    gain = np.ones(TAXELS)
    gain[CORNER] = 1.2
    watch = Watch(calibration=replace(Calibration.nominal(SENSOR), pyroelectric_gain=gain))
    forces = history(watch, SENSOR, 3.5, temperature=lambda time: 25.0 + 1.0 * max(time - 1.0, 0.0))
    late = forces[2500:, CORNER].reshape(-1, 100).mean(axis=1)
    assert np.abs(late).max() < 0.1 * THRESHOLD, "0.2 N/s, extrapolated over 20 ms, would be 4 mN"
    belief = watch.estimator.belief
    # Zeros tell the ratios of the responses: a factor that all have looks like another change of temperature.
    response = 1.0 + belief.error[:, 3]
    others = np.delete(response, CORNER)
    assert response[CORNER] / others.mean() == pytest.approx(1.0 / 1.2, abs=0.005)


@pytest.mark.parametrize("seed", range(3))
def test_a_held_force_follows_a_chip_that_suddenly_cools_after_150_ms(seed: int) -> None:
    def temperature(time: float) -> float:
        since, lag = max(time - 2.0, 0.0), SENSOR.device.thermal_time_constant
        return 25.0 - 2.0 * (since + lag * math.expm1(-since / lag))

    watch = Watch()
    force = press(1.0, 1.0, 60.0)
    forces = history(watch, SENSOR, 2.25, force=force, shape=PATCH, temperature=temperature, seed=seed)
    # 2 K/s change each taxel by 2 N/s, which is 1 N on all of them between two blocks. The sensors turn out to be
    # much faster than expected.
    assert np.abs(forces[2150:].sum(axis=1) - 1.0).max() < 0.1


def test_contact_thresholds_do_not_follow_what_a_response_to_temperature_makes_uncertain_in_a_touch() -> None:
    def threshold(rate: float) -> float:
        watch = Watch()
        history(
            watch,
            SENSOR,
            3.0,
            force=press(1.0, 1.0, 60.0),
            shape=PATCH,
            temperature=lambda time: 25.0 + rate * max(time - 2.0, 0.0),
        )
        assert watch.deviation()[MIDDLE] > 0.02 * rate
        return float(watch.estimator.variance(np.empty(TAXELS))[MIDDLE])

    assert threshold(0.3) < threshold(0.0) + (0.5 * THRESHOLD) ** 2


def test_stored_blocks_are_processed_again_once_for_a_force_that_grows_slowly() -> None:
    # 5 mN a second on one taxel, below the contact threshold: once suspected it stays so, and is no zero in between.
    watch = Watch()
    forces = history(watch, SENSOR, 4.0, force=press(0.015, 1.0, 60.0, rise=3.0))
    assert watch.estimator.processed_again <= 2
    assert forces[-1][MIDDLE] == pytest.approx(0.015, abs=0.003)


def test_a_faulty_taxel_is_zero_while_nothing_touches_as_a_noisy_one_counts_in_the_next_touch() -> None:
    watch, force = Watch(), np.zeros(TAXELS)
    for time, scan in scans(SENSOR, 2.0):
        if time >= 1.0:
            scan.counts[MIDDLE] -= 5 * STEP
        if round(1000 * time) == 500:
            watch.estimator.ignore(np.arange(TAXELS) == MIDDLE)
        force = watch.process(time, scan)
    assert abs(force[MIDDLE]) < 0.25 * THRESHOLD


@pytest.mark.parametrize(
    ("informative", "limit", "valid"), [(True, 0.2, True), (True, 1e-3, False), (False, 1e-3, True)]
)
def test_a_force_on_a_faulty_taxel_counts_in_the_certainty_of_sums_if_its_reading_does(
    informative: bool, limit: float, valid: bool
) -> None:
    """Also where no contact lists it, as after an overload, whose thresholds are higher for a while."""
    watch, ignored = Watch(), np.arange(TAXELS) == MIDDLE
    shape = ignored + 0.03 * (np.arange(TAXELS) == MIDDLE + 1)
    watch.estimator.max_relative_uncertainty = limit
    for time, scan in scans(SENSOR, 3.0, force=press(2.0, 1.0, 2.0), shape=shape):
        if round(1000 * time) == 500:
            watch.estimator.ignore(ignored)
            watch.estimator.informative[:] = ignored & informative
        watch.process(time, scan)
        watch._touched[:] = False  # no contact is listed
        watch._limit[:] = np.inf
    held = np.array(watch.valid)[1300:1900]
    assert held.all() == valid and held.any() == valid
    assert all(watch.valid[2500:])


def steps_in_a_long_touch(seed: int, begin: float, rate: float) -> tuple[float, float]:
    """Return for a taxel with telegraph noise the coverage during a touch of 20 s, and its force a second later."""
    random, watch, high, errors = np.random.default_rng(seed), Watch(), False, []
    force = press(10.0, begin, begin + 20.0)
    for time, scan in scans(SENSOR, begin + 21.0, force=force, shape=FINGERTIP, rate=rate):
        high ^= bool(random.random() < 1.0 / rate)
        scan.counts[CORNER] += STEP * high
        error = watch.process(time, scan)[CORNER] - 10.0 * FINGERTIP[CORNER] * (time < begin + 20.0)
        if time > begin + 1.0:
            errors.append(error / watch.deviation()[CORNER])
    return float(np.mean(np.abs(errors) < 2.0)), abs(float(watch.estimator.force[CORNER]))


@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (4, 5))])
def test_a_taxel_with_telegraph_noise_does_not_stay_in_contact_after_a_long_touch(seed: int) -> None:
    # At rest its offset is that of the present level; in the mean of a long touch it is half a step away.
    covered, left = steps_in_a_long_touch(seed, 10.0, 500.0)
    assert covered >= 0.9
    assert left < THRESHOLD


@pytest.mark.slow
def test_telegraph_noise_that_the_rest_before_a_touch_did_not_show_is_found_during_the_touch() -> None:
    # Within a second it may not step at all. Its first steps during the touch are not covered.
    found = [steps_in_a_long_touch(seed, 1.0, 1000.0) for seed in range(5)]
    assert np.mean([covered for covered, _ in found]) >= 0.9
    assert max(left for _, left in found) < THRESHOLD


def test_a_film_that_hardly_responds_to_its_temperature_is_one_that_does_not() -> None:
    # 2.5 N on all taxels: as a temperature of that film, its square is beyond what a number can be.
    watch = Watch(with_device(pyroelectric_coefficient=2e-290))
    shape = np.full(TAXELS, 1.0 / TAXELS)
    forces = history(watch, with_device(pyroelectric_coefficient=0.0), 3.0, force=press(2.5, 1.5, 9.0), shape=shape)
    assert np.isfinite(forces).all()
    assert forces[-1].sum() == pytest.approx(2.5, rel=0.02)


@pytest.mark.parametrize("impossible", ["variance", "temperature"])
def test_a_filter_that_diverged_starts_over(impossible: str) -> None:
    watch = Watch()
    stream = scans(SENSOR, 4.0, force=press(1.0, 3.0, 9.0))
    for time, scan in islice(stream, 1000):
        watch.process(time, scan)
    assert watch.valid[-1]
    belief = watch.estimator.belief
    if impossible == "variance":
        belief.own[:, 0, 0] = math.nan
    else:
        belief.error[:, 0] = 1e5  # all forces fall by 1e5 N, as if the film cooled
    forces = np.array([watch.process(time, scan).copy() for time, scan in stream])
    assert watch.estimator.restarts == TAXELS
    assert not watch.valid[1020]
    assert all(watch.valid[2500:])
    assert forces[2500:].sum(axis=1).mean() == pytest.approx(1.0, rel=0.05)
