# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The Kalman filter of the baseline against two-state filters by hand, closed forms and a simulated drift."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.estimation.drift_filter import BLOCKS, TIME_CONSTANTS, DriftFilter

TAU = np.array([0.2, 0.4, 1.0])
NOISE = np.array([1e-4, 4e-4, 9e-4])
BLOCK, SCANS = 0.02, 20
SQUARES = SCANS * (BLOCK / SCANS) ** 2
"""Sum of the squares of the steps in a block [s2]."""
ALL = np.ones(3, np.bool_)
NONE = np.zeros(3, np.bool_)
OFFSET, OFFSET_VARIANCE = np.array([0.3, -0.2, 0.1]), np.array([0.04, 0.01, 0.09])
FORCE_VARIANCE, COMMON = np.array([0.01, 0.02, 0.03]), np.array([-0.01, 0.005, 0.0])


def made(flicker: float = 0.0, drift: float = 0.0, tau: np.ndarray = TAU) -> DriftFilter:
    """Return a filter with known offsets; without flicker each has one state that stays as it is."""
    filter_ = DriftFilter(tau, NOISE, flicker, drift)
    filter_.restart(ALL, OFFSET, OFFSET_VARIANCE, FORCE_VARIANCE, COMMON)
    return filter_


def by_hand(taxel: int) -> np.ndarray:
    """Return the covariance of force error and offset error of a taxel of `made`."""
    common = COMMON[taxel]
    return np.array([[FORCE_VARIANCE[taxel], common], [common, OFFSET_VARIANCE[taxel]]])


def predicted(covariance: np.ndarray, taxel: int, drift: float = 0.0) -> np.ndarray:
    """Return it after one block: each scan integrates (reading - offset)*h/tau."""
    step = np.array([[1.0, -BLOCK / TAU[taxel]], [0.0, 1.0]])
    added = NOISE[taxel] * SQUARES / TAU[taxel] ** 2 + drift * BLOCK
    return step @ covariance @ step.T + np.diag([added, 0.0])


def test_a_restart_sets_offsets_and_variances_of_its_taxels_alone() -> None:
    filter_ = made()
    assert filter_.offset == pytest.approx(OFFSET)
    assert filter_.variance == pytest.approx(FORCE_VARIANCE)
    assert filter_.offset_variance == pytest.approx(OFFSET_VARIANCE)
    one = np.array([False, True, False])
    filter_.restart(one, np.array([7.0]), np.array([8.0]), np.array([9.0]), np.array([0.0]))
    assert filter_.offset == pytest.approx([0.3, 7.0, 0.1])
    assert filter_.offset_variance == pytest.approx([0.04, 8.0, 0.09])
    assert filter_.variance == pytest.approx([0.01, 9.0, 0.03])


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_the_uncertainty_grows_by_the_offset_the_noise_and_the_temperature(drift: float) -> None:
    filter_ = made(drift=drift)
    filter_.predict(BLOCK, SQUARES)
    for taxel in range(3):
        expected = predicted(by_hand(taxel), taxel, drift)
        assert filter_.variance[taxel] == pytest.approx(expected[0, 0])
        assert filter_.offset_variance[taxel] == pytest.approx(expected[1, 1])
    assert filter_.offset == pytest.approx(OFFSET)


def test_without_flicker_two_blocks_are_as_uncertain_as_one_of_twice_the_time() -> None:
    twice, once = made(), made()
    twice.predict(BLOCK, SQUARES)
    twice.predict(BLOCK, SQUARES)
    once.predict(2 * BLOCK, 2 * SQUARES)
    assert twice.variance == pytest.approx(once.variance)
    assert twice.offset_variance == pytest.approx(once.offset_variance)


def test_flicker_adds_a_variance_per_decade_and_a_random_walk() -> None:
    flicker, seconds = 1e-3, 30.0
    decade = flicker * math.log(10.0)
    filter_ = made(flicker)
    assert filter_.random_walk == pytest.approx(2.0 * decade / TIME_CONSTANTS[0])
    # The processes of the faster decades are stationary from the start.
    assert filter_.offset_variance == pytest.approx(OFFSET_VARIANCE + 2 * decade)
    for _ in range(round(seconds / BLOCK)):
        filter_.predict(BLOCK, SQUARES)
    walked = 2.0 * decade / TIME_CONSTANTS[0] * seconds
    assert filter_.offset_variance == pytest.approx(OFFSET_VARIANCE + 2 * decade + walked)


def test_an_update_is_that_of_a_kalman_filter_by_hand() -> None:
    filter_ = made()
    filter_.predict(BLOCK, SQUARES)
    noise = NOISE / SCANS
    mean = np.array([0.05, -0.03, 0.02])
    expected = filter_.innovation_variance(BLOCK, noise)
    gain = filter_.gain(expected).copy()
    filter_.update(np.array([True, True, False]), mean, expected)
    for taxel in range(3):
        before = predicted(by_hand(taxel), taxel)
        measured = np.array([1.0, 0.5 * BLOCK / TAU[taxel]])  # the force error half a block ago
        innovation = measured @ before @ measured + noise[taxel]
        gains = before @ measured / innovation
        assert expected[taxel] == pytest.approx(innovation)
        assert gain[taxel] == pytest.approx(gains[0])
        updated = taxel < 2
        after = before - np.outer(gains, gains) * innovation * updated
        assert filter_.variance[taxel] == pytest.approx(after[0, 0])
        assert filter_.offset_variance[taxel] == pytest.approx(after[1, 1])
        assert filter_.offset[taxel] == pytest.approx(OFFSET[taxel] - updated * gains[1] * mean[taxel])


def test_a_constant_offset_is_found_and_the_error_is_as_large_as_stated() -> None:
    random = np.random.default_rng(1)
    taxels, seconds = 400, 1.0
    tau, noise = np.full(taxels, 0.3), np.full(taxels, 1e-4)
    everywhere = np.ones(taxels, np.bool_)
    filter_ = DriftFilter(tau, noise, 0.0, 0.0)
    filter_.restart(everywhere, np.zeros(taxels), np.full(taxels, 0.01), np.full(taxels, 1e-4), np.zeros(taxels))
    truth = 0.1 * random.standard_normal(taxels)
    error = 0.01 * random.standard_normal(taxels)
    for _ in range(round(seconds / BLOCK)):
        total = np.zeros(taxels)
        for _ in range(SCANS):
            reading = 0.01 * random.standard_normal(taxels)
            error += (truth + reading - filter_.offset) * (BLOCK / SCANS) / tau
            total += error + 0.01 * random.standard_normal(taxels)
        filter_.predict(BLOCK, SQUARES)
        mean = total / SCANS
        expected = filter_.innovation_variance(BLOCK, noise / SCANS)
        change = -filter_.gain(expected) * mean
        filter_.update(everywhere, mean, expected)
        error += change
        filter_.record_correction(change)
    # Mean squares of 400 taxels are within 20 % of the variance (2.8 standard deviations).
    assert np.mean((filter_.offset - truth) ** 2 / filter_.offset_variance) == pytest.approx(1.0, abs=0.2)
    assert np.mean(error**2 / filter_.variance) == pytest.approx(1.0, abs=0.2)
    assert np.sqrt(filter_.offset_variance).max() < 0.01


def test_the_force_error_can_be_reset_and_offsets_made_uncertain() -> None:
    filter_ = made()
    one = np.array([False, True, False])
    filter_.reset_force_error(one, np.array([0.5]))
    filter_.inflate_offset_variance(one, 0.25)
    assert filter_.variance == pytest.approx([0.01, 0.5, 0.03])
    assert filter_.offset_variance == pytest.approx([0.04, 0.26, 0.09])
    # Its covariance is gone, too: the next prediction adds both variances.
    filter_.predict(BLOCK, SQUARES)
    added = (0.26 * BLOCK**2 + NOISE[1] * SQUARES) / TAU[1] ** 2
    assert filter_.variance[1] == pytest.approx(0.5 + added)


def test_a_force_set_to_the_signal_is_as_uncertain_as_offset_and_reading() -> None:
    filter_ = made(flicker=1e-3)
    filter_.reset_force_to_signal()
    assert filter_.variance == pytest.approx(NOISE + filter_.offset_variance)
    # It has the error of the offset, negated: each prediction adds to it.
    before, offset = filter_.variance.copy(), filter_.offset_variance[2]
    filter_.predict(BLOCK, SQUARES)
    assert filter_.variance[2] > before[2] + 2 * (BLOCK / TAU[2]) * 0.9 * offset


def test_the_mean_offset_is_set_and_the_differences_stay() -> None:
    filter_ = made()
    filter_.set_mean_offset(np.array([True, False, True]), 0.5)
    assert filter_.offset == pytest.approx([0.6, 0.1, 0.4])


def run(filter_: DriftFilter, means: list[float], corrections: list[float]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Run blocks with these mean forces and corrections of every force; return the forces and the past offsets."""
    force, offsets = np.zeros(3), [filter_.offset.copy()]
    for mean, correction in zip(means, corrections, strict=True):
        force -= BLOCK / filter_.time_constant * filter_.offset
        filter_.predict(BLOCK, SQUARES)
        noise = NOISE / SCANS
        expected = filter_.innovation_variance(BLOCK, noise)
        filter_.update(ALL, np.full(3, mean), expected)
        force += correction
        filter_.record_correction(correction)
        filter_.store(np.full(3, mean), noise)
        offsets.append(filter_.offset.copy())
    return force, offsets


CORRECTIONS = [0.001, -0.002, 0.003, -0.004, 0.005, -0.006, 0.007, -0.008]


@pytest.mark.parametrize("pressing", [0, 1, 3])
def test_a_rolled_back_taxel_is_as_if_nothing_had_been_learnt_since_the_touch_began(pressing: int) -> None:
    filter_ = made()
    means = [-0.01] * (8 - pressing) + [0.2] * pressing
    force, offsets = run(filter_, means, CORRECTIONS)
    after = filter_.offset.copy(), filter_.variance.copy(), filter_.offset_variance.copy()
    back = pressing + 1  # the touch may have begun in the block before
    change, blocks = filter_.roll_back(np.array([True, False, True]))
    assert blocks.tolist() == [back, back]
    reached = made()
    then, _ = run(reached, means[:-back], CORRECTIONS[:-back])
    reached.predict(back * BLOCK, back * SQUARES)
    for taxel, corrected in zip([0, 2], change, strict=True):
        leaked = back * BLOCK / TAU[taxel] * offsets[8 - back][taxel]
        assert force[taxel] + corrected == pytest.approx(then[taxel] - leaked)
        assert filter_.offset[taxel] == pytest.approx(offsets[8 - back][taxel])
        assert filter_.variance[taxel] == pytest.approx(reached.variance[taxel])
        assert filter_.offset_variance[taxel] == pytest.approx(reached.offset_variance[taxel])
    assert (filter_.offset[1], filter_.variance[1], filter_.offset_variance[1]) == tuple(part[1] for part in after)


def test_each_taxel_is_rolled_back_to_its_own_touch() -> None:
    filter_ = made()
    noise = NOISE / SCANS
    for block in range(10):
        filter_.predict(BLOCK, SQUARES)
        filter_.store(np.where(np.array([8, 5, 20]) <= block, 0.2, 0.0), noise)
    assert filter_.roll_back(ALL)[1].tolist() == [3, 6, 1]


def test_no_taxel_is_rolled_back_further_than_states_are_kept() -> None:
    filter_ = made()
    run(filter_, [0.2] * 3 * BLOCKS, [0.0] * 3 * BLOCKS)
    assert filter_.roll_back(ALL)[1].tolist() == [BLOCKS - 1] * 3


@pytest.mark.parametrize("reset", [False, True])
def test_without_kept_states_nothing_is_rolled_back(reset: bool) -> None:
    filter_ = made()
    if reset:
        run(filter_, [0.2] * 5, [0.1] * 5)
        filter_.reset_force_to_signal()
    change, blocks = filter_.roll_back(ALL)
    assert change.tolist() == [0.0] * 3
    assert blocks.tolist() == [0] * 3


def test_taxels_that_are_not_masked_are_not_updated() -> None:
    filter_ = made()
    filter_.predict(BLOCK, SQUARES)
    before = filter_.offset.copy(), filter_.variance.copy()
    filter_.update(NONE, np.ones(3), filter_.innovation_variance(BLOCK, NOISE))
    assert (filter_.offset == before[0]).all()
    assert (filter_.variance == before[1]).all()
