# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Faulty taxels: detected, flagged, never reported as 0, excluded from contacts, and used again after recovery."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import DEAD_SHARE, CountHistory
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.reconstruction.taxel_faults import TaxelFaultDetector, TaxelStatus, longest_run
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.neighbour_estimate import (
    INTERPOLATION_UNCERTAINTY,
    NeighbourInterpolation,
    most_over_neighbours,
)
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import volts_per_count
from reference.dense_pressure import sphere_forces
from support.long_cases import long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
CLASSIC = replace(SENSOR, can=replace(SENSOR.can, fd=False))
LAYOUT = SENSOR.layout
REST = 0x8000
Fault = Callable[[int, Scan], None]


def sphere(x: float, y: float, force: float, radius: float, modulus: float) -> NDArray[np.float64]:
    spread = SENSOR.device.contact_spread
    forces: NDArray[np.float64] = sphere_forces(x, y, force, radius, modulus, spread, LAYOUT.pitch_x, LAYOUT.rows)
    return forces


def finger(x: float, y: float) -> NDArray[np.float64]:
    return sphere(x, y, 1.0, 6e-3, 1e6)


FINGER = finger(0.3e-3, -0.2e-3)
SHARP = sphere(0.1e-3, 0.1e-3, 0.1, 4e-3, 8e6) / 0.1


def dead(taxel: int) -> Fault:
    rng = np.random.default_rng(5)

    def fault(index: int, scan: Scan) -> None:
        scan.counts[taxel] = REST + round(rng.normal(0, SENSOR.adc.noise / volts_per_count(SENSOR)))

    return fault


def stuck(taxel: int, count: int, begin: int = 0, end: int = 10**9) -> Fault:
    def fault(index: int, scan: Scan) -> None:
        if begin <= index < end:
            scan.counts[taxel] = count

    return fault


def frozen(taxel: int, begin: int, end: int) -> Fault:
    """Return a fault in which a taxel keeps the counts that it has at its begin."""
    held = [0]

    def fault(index: int, scan: Scan) -> None:
        if begin <= index < end:
            scan.counts[taxel] = held[0]
        else:
            held[0] = int(scan.counts[taxel])

    return fault


def noisy(taxel: int, times: float, begin: int = 0, end: int = 10**9) -> Fault:
    rng = np.random.default_rng(6)

    def fault(index: int, scan: Scan) -> None:
        if begin <= index < end:
            added = rng.normal(0, times * SENSOR.adc.noise / volts_per_count(SENSOR))
            scan.counts[taxel] = min(max(round(int(scan.counts[taxel]) + added), 0), 0xFFFF)

    return fault


def run(
    fault: Fault,
    duration: float,
    force: Callable[[float], float] = lambda _: 0.0,
    shape: NDArray[np.float64] = FINGER,
    sensor: Sensor = SENSOR,
    rate: float = 1000.0,
) -> tuple[Reconstructor, list[Reconstruction], list[NDArray[np.uint8]]]:
    """Return the reconstructor, its results, and the status of the taxels after each scan."""
    reconstructor = Reconstructor(sensor)
    results, statuses = [], []
    for time, scan in scans(SENSOR, duration, force=force, shape=shape, rate=rate):
        if not sensor.can.fd:
            scan.counts[:] = (scan.counts >> 4 << 4) | scan.counts >> 12
        fault(round(time * rate), scan)
        results.append(copy.copy(reconstructor.process(scan)))
        statuses.append(reconstructor.status().copy())
    return reconstructor, results, statuses


def well(index: int, scan: Scan) -> None:
    """No fault."""


def assert_force(results: list[Reconstruction], force: float) -> None:
    """Assert that each of these scans is valid and has one contact, of that force within three deviations [N]."""
    for result in results:
        [contact] = result.contacts
        assert result.valid
        assert abs(contact.region.force - force) < 3.0 * math.sqrt(contact.region.force_variance)


def standard_uncertainty(results: list[Reconstruction]) -> float:
    """Return the standard uncertainty of the force of the only contact in the last scan [N]."""
    [contact] = results[-1].contacts
    return math.sqrt(contact.region.force_variance)


def found_at(statuses: list[NDArray[np.uint8]], taxel: int, status: TaxelStatus) -> int:
    """Return the index of the first scan with that status of the taxel; all other taxels must stay without fault."""
    others = np.array(statuses)[:, np.arange(LAYOUT.taxels) != taxel]
    assert not others.any()
    return [row[taxel] for row in statuses].index(status)


@pytest.mark.parametrize("taxel", long_cases([12, 13, 7, 2, 24], [12, 24]))
def test_a_dead_taxel_is_detected_on_first_touch_and_the_contact_continues_without_it(taxel: int) -> None:
    x, y = LAYOUT.positions[taxel] * 0.8
    shape = finger(x, y)
    reconstructor, results, statuses = run(dead(taxel), 1.5, press(1.5, 0.5, 9.0), shape)
    assert found_at(statuses, taxel, TaxelStatus.DEAD) < 500 + 150
    [contact] = results[-1].contacts
    assert taxel not in contact.region.taxels
    estimated = shape[taxel] * 1.5
    assert abs(contact.region.force - 1.5 * shape.sum()) < 2 * INTERPOLATION_UNCERTAINTY * estimated + 0.01
    _, undisturbed, _ = run(well, 1.5, press(1.5, 0.5, 9.0), shape)
    expected = math.hypot(standard_uncertainty(undisturbed), INTERPOLATION_UNCERTAINTY * estimated)
    assert standard_uncertainty(results) == pytest.approx(expected, rel=0.25)
    assert math.dist(contact.region.centre_of_pressure, (x, y)) < 0.15e-3
    image = reconstructor.image()
    assert math.isnan(image.force[taxel])
    assert math.isnan(image.standard_deviation[taxel])
    assert np.isfinite(np.delete(image.force, taxel)).all()
    assert results[-1].valid
    assert reconstructor.faulty == 1


def test_a_gap_between_two_contacts_is_not_a_dead_taxel() -> None:
    small = [sphere(x, 0.0, 1.0, 1.5e-3, 8e6) for x in (-2e-3, 2e-3)]
    _, _, statuses = run(lambda index, scan: None, 1.5, press(2.0, 0.5, 1.2), sum(small))
    assert not np.any(statuses)


def test_one_or_two_spheres_anywhere_mark_no_taxel_dead() -> None:
    rng = np.random.default_rng(3)
    surroundings, none, everywhere = NeighbourInterpolation(LAYOUT), np.zeros(25, np.bool_), np.arange(25)
    compared = 0
    spheres = []
    for _ in range(40):
        x, y = rng.uniform(-3e-3, 3e-3, 2)
        radius, modulus = rng.choice([1.5e-3, 3e-3, 6e-3]), rng.choice([1e6, 2e6, 8e6])
        spheres.append(sphere(x, y, 2.0, radius, modulus))
    pairs = [spheres[i] + spheres[j] for i, j in rng.integers(0, len(spheres), (400, 2))]
    for force in spheres + pairs:
        least = surroundings.lower_bound(force, none, everywhere, 1.7e-3)
        pressed = least >= 5 * SENSOR.contact.threshold
        compared += int(np.count_nonzero(pressed))
        assert (force[pressed] >= 1.5 * DEAD_SHARE * least[pressed]).all()
    assert compared > 500


def test_interpolated_force_is_within_the_stated_uncertainty() -> None:
    rng = np.random.default_rng(4)
    surroundings, none = NeighbourInterpolation(LAYOUT), np.zeros(25, np.bool_)
    errors = []
    for _ in range(40):
        x, y = rng.uniform(-3e-3, 3e-3, 2)
        force = sphere(x, y, 1.5, rng.choice([1.5e-3, 6e-3]), 2e6)
        read = force * rng.normal(1.0, 0.05, 25) + rng.normal(0, 0.35e-3, 25)
        estimate, _ = surroundings.interpolate(read, none, np.arange(25), 1.7e-3, *most_over_neighbours(SENSOR))
        pressed = force > SENSOR.contact.threshold
        errors += (estimate[pressed] / force[pressed] - 1.0).tolist()
    assert len(errors) > 200
    assert np.mean(np.abs(errors) < 2 * INTERPOLATION_UNCERTAINTY) >= 0.95


@pytest.mark.parametrize("count", long_cases([REST, 0x9000, 0, 0xFFFF], [REST, 0xFFFF]))
def test_a_taxel_stuck_from_the_start_is_detected_and_does_not_delay_the_others(count: int) -> None:
    reconstructor, results, statuses = run(stuck(12, count), 2.5, press(1.5, 2.0, 9.0))
    at = found_at([np.where(row == TaxelStatus.SATURATED, 0, row) for row in statuses], 12, TaxelStatus.STUCK)
    assert at < 200
    assert results[500].valid
    assert results[-1].valid
    image = reconstructor.image()
    assert math.isnan(image.force[12])
    [contact] = results[-1].contacts
    assert abs(contact.region.force - 1.5) < 2 * math.sqrt(contact.region.force_variance)
    assert abs(image.total - 1.5) < 2 * image.total_standard_deviation < 0.5
    assert image.load.sum() == pytest.approx(image.total, rel=1e-6)


def test_the_force_on_a_noisy_taxel_that_is_informative_counts_by_its_own_reading() -> None:
    reconstructor, results, _ = run(noisy(12, 5.0), 1.5, press(1.5, 0.9, 9.0))
    image = reconstructor.image()
    assert image.status[12] == TaxelStatus.NOISY
    assert math.isnan(image.force[12])
    assert results[-1].valid
    assert image.load[12] == pytest.approx(1.5 * FINGER[12], abs=0.05)
    assert abs(image.total - 1.5) < 2 * image.total_standard_deviation
    sums = reconstructor.covariance(np.vstack([np.ones(LAYOUT.taxels), np.eye(LAYOUT.taxels)]))
    assert sums[0, 0] == pytest.approx(image.total_standard_deviation**2, rel=1e-9)
    undisturbed = run(well, 1.5, press(1.5, 0.9, 9.0))[0].image()
    expected = undisturbed.total_standard_deviation
    assert image.total_standard_deviation == pytest.approx(expected, rel=0.1), "gain and leakage are common to all"
    blind = run(dead(12), 1.5, press(1.5, 0.9, 9.0))[0].image()
    assert image.load_variance[12] < 0.25 * blind.load_variance[12], "of what its neighbours tell"


def test_without_a_contact_a_faulty_taxel_counts_nothing() -> None:
    reconstructor, _, _ = run(noisy(12, 50.0), 1.0)
    image = reconstructor.image()
    assert image.status[12] == TaxelStatus.NOISY
    assert (image.load[12], image.load_variance[12]) == (0.0, 0.0)
    assert abs(image.total) < 4 * image.total_standard_deviation


def test_without_a_contact_a_noisy_taxel_that_is_informative_counts_by_its_own_reading() -> None:
    """No contact lists it alone; a total force without it would be wrong, and would not say so.

    Where touches may warm the film by more, so light a touch is not valid: warmth may hide as much.
    """
    cool = ReconstructionSettings(priors=ErrorPriors(warmth=ErrorPriors().warmth_least))
    total, deviation, fault, reconstructor = [], [], noisy(12, 5.0), Reconstructor(SENSOR, settings=cool)
    for time, scan in scans(SENSOR, 1.5, force=press(0.02, 0.9, 9.0), shape=SHARP):
        fault(round(time * 1000.0), scan)
        result = reconstructor.process(scan)
        if time > 1.2:
            image = reconstructor.image()
            assert not result.contacts and result.valid
            total.append(image.total)
            deviation.append(image.total_standard_deviation)
    assert image.status[12] == TaxelStatus.NOISY
    assert SHARP[12] > 0.5
    assert np.mean(total) == pytest.approx(0.02, rel=0.2)
    assert np.mean(np.abs(np.subtract(total, 0.02)) < 2.0 * np.array(deviation)) > 0.9


def test_a_briefly_overloaded_taxel_is_saturated_and_not_stuck() -> None:
    _, _, statuses = run(stuck(12, 0xFFFF, 600, 850), 1.2, press(6.0, 0.6, 9.0))
    # The first scan in which it alone is out of range is refused: that might be a burst.
    assert {row[12] for row in statuses[601:850]} == {TaxelStatus.SATURATED}
    assert not np.any(statuses[900:])


def test_a_taxel_that_dies_while_pressed_does_not_keep_a_contact_forever() -> None:
    dying = dead(12)

    def fault(index: int, scan: Scan) -> None:
        if index >= 700:
            dying(index, scan)

    _, results, statuses = run(fault, 2.5, press(1.5, 0.5, 1.5))
    assert found_at(statuses, 12, TaxelStatus.STUCK) > 1500
    assert not any(result.contacts for result in results[1950:])


def test_a_taxel_with_a_loose_wire_does_not_delay_the_others() -> None:
    def fault(index: int, scan: Scan) -> None:
        if index // 100 % 2:
            scan.counts[12] = 0

    _, results, statuses = run(fault, 3.0, press(1.5, 1.5, 2.5))
    assert all(result.valid for result in results[1300:])
    assert {int(row[12]) for row in statuses[1300:]} <= {TaxelStatus.NOISY, TaxelStatus.STUCK}
    [contact] = results[2400].contacts
    assert abs(contact.region.force - 1.5) < 2 * math.sqrt(contact.region.force_variance)


def test_a_taxel_that_recovers_after_sticking_under_load_is_used_again() -> None:
    reconstructor, results, statuses = run(
        frozen(12, 600, 900), 4.0, lambda t: press(1.5, 0.5, 1.2)(t) + press(1.0, 3.0, 9.0)(t)
    )
    assert found_at(statuses, 12, TaxelStatus.STUCK) < 650
    assert statuses[2900][12] == TaxelStatus.OK
    assert results[-1].valid
    assert reconstructor.image().force[12] == pytest.approx(FINGER[12], abs=0.02)


def test_the_reading_of_a_taxel_that_sticks_under_load_is_in_no_deviation() -> None:
    """It grows as if the force did that keeps such a signal up: its force is interpolated."""
    _, undisturbed, _ = run(well, 4.0, press(1.5, 0.5, 9.0))
    _, results, statuses = run(frozen(12, 600, 9000), 4.0, press(1.5, 0.5, 9.0))
    assert statuses[-1][12] == TaxelStatus.STUCK
    assert_force(results[700:], 1.5)
    estimated = FINGER[12] * 1.5
    expected = math.hypot(standard_uncertainty(undisturbed), INTERPOLATION_UNCERTAINTY * estimated)
    assert standard_uncertainty(results) == pytest.approx(expected, rel=0.25)


def test_a_taxel_at_the_rail_from_the_start_is_stuck_and_counts_neither_as_saturated_nor_as_unsettled() -> None:
    reconstructor, results, statuses = run(stuck(0, 0xFFFF), 1.5)
    assert statuses[-1][0] == TaxelStatus.STUCK
    assert results[-1].valid
    assert (results[-1].saturated, reconstructor.unsettled, reconstructor.faulty) == (0, 0, 1)


def test_a_taxel_that_no_longer_sticks_is_used_again_after_the_touch() -> None:
    """It restarts without a force, as nothing would tell it under the touch."""
    _, results, statuses = run(frozen(12, 600, 900), 6.0, press(1.5, 0.5, 4.0))
    assert {int(row[12]) for row in statuses[650:4000]} == {TaxelStatus.STUCK}
    assert_force(results[1100:3990], 1.5)
    assert statuses[-1][12] == TaxelStatus.OK
    assert results[-1].valid


def test_a_dead_taxel_that_responds_again_is_used_again_after_the_touch() -> None:
    counts: list[int] = []

    def fault(index: int, scan: Scan) -> None:
        if 500 <= index < 4000:  # as if nothing touched it
            scan.counts[12] = counts[index % 500]
        counts.append(int(scan.counts[12]))

    _, results, statuses = run(fault, 8.0, lambda t: press(1.5, 0.5, 1.5)(t) + press(1.5, 4.5, 6.0)(t))
    assert {int(row[12]) for row in statuses[800:6000]} == {TaxelStatus.DEAD}
    assert_force(results[4700:5990], 1.5)
    assert statuses[-1][12] == TaxelStatus.OK
    assert results[-1].valid


def test_a_coarse_adc_with_constant_counts_is_not_stuck() -> None:
    assert longest_run(CLASSIC) == math.inf
    assert 10 < longest_run(SENSOR) < 200
    _, results, statuses = run(lambda index, scan: None, 4.0, press(1.5, 3.0, 3.5), sensor=CLASSIC)
    assert not np.any(statuses)
    assert results[3300].contacts


@pytest.mark.parametrize(
    ("times", "rate"), long_cases([(8.0, 1000.0), (200.0, 1000.0), (20.0, 100.0)], [(8.0, 1000.0), (20.0, 100.0)])
)
def test_a_noisy_taxel_is_detected_and_recovers(times: float, rate: float) -> None:
    fault = noisy(7, times, round(0.5 * rate), round(2 * rate))
    reconstructor, results, statuses = run(fault, 5.0, rate=rate)
    found = found_at(statuses, 7, TaxelStatus.NOISY) / rate
    assert 0.5 < found < 1.2
    assert not any(result.contacts for result in results[round((found + 0.05) * rate) :])
    assert all(result.valid for result in results[round((found + 0.05) * rate) : round(2 * rate)])
    assert statuses[-1][7] == TaxelStatus.OK
    assert results[-1].valid
    assert reconstructor.faulty == 0


@pytest.mark.parametrize("taxel", long_cases([12, 11, 8], [12]))
def test_a_noisy_taxel_is_not_listed_but_its_signal_is_used(taxel: int) -> None:
    """With five times the noise a touch is still detected, better than by interpolation from neighbours."""
    _, results, statuses = run(noisy(taxel, 5.0), 1.5, press(1.5, 0.7, 9.0, rise=0.1))
    assert statuses[690][taxel] == TaxelStatus.NOISY
    first = next(result for result in results if result.contacts)
    assert first.sequence <= 700 + round(100 * SENSOR.contact.threshold / (1.5 * FINGER.max())) + 2
    for result in results[820:]:
        [contact] = result.contacts
        assert taxel not in contact.region.taxels
        assert math.dist(contact.region.centre_of_pressure, (0.3e-3, -0.2e-3)) < 0.06e-3
        assert abs(contact.region.force - 1.5) < 0.03
    _, undisturbed, _ = run(well, 1.5, press(1.5, 0.7, 9.0, rise=0.1))
    assert standard_uncertainty(results) == pytest.approx(standard_uncertainty(undisturbed), rel=0.1)


def test_a_taxel_too_noisy_to_detect_a_touch_is_interpolated() -> None:
    _, results, statuses = run(noisy(12, 40.0), 1.5, press(1.5, 0.9, 9.0))
    assert statuses[890][12] == TaxelStatus.NOISY
    assert not any(result.contacts for result in results[500:899])
    _, undisturbed, _ = run(well, 1.5, press(1.5, 0.9, 9.0))
    expected = math.hypot(standard_uncertainty(undisturbed), INTERPOLATION_UNCERTAINTY * 1.5 * FINGER[12])
    assert standard_uncertainty(results) == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize("lost", [2, 40, 130])
def test_scans_lost_while_charge_leaks_make_no_taxel_noisy(lost: int) -> None:
    """The charge that leaks in a gap after a release changes the counts by far more than their noise."""
    reconstructor, first = Reconstructor(SENSOR), 1150
    for time, scan in scans(SENSOR, 2.0, force=press(2.0, 0.3, 1.0), shape=FINGER):
        if not first <= round(time * 1000) < first + lost:
            reconstructor.process(scan)
            assert reconstructor.faulty == 0, f"{time:g} s"


def test_a_row_after_scans_that_had_no_room_is_not_close_to_the_one_before() -> None:
    history = CountHistory(4, 1)
    for number in range(6):
        history.add(np.array([number], np.uint16), True)
    history.keep(2)
    for number in range(6, 8):
        history.add(np.array([number], np.uint16), True)
    assert history.counts[: history.filled, 0].tolist() == [2, 3, 6, 7]
    assert history.close[2:4].tolist() == [False, True]
    history.keep(2)
    history.add(np.array([8], np.uint16), True)
    assert history.close[2], "none was left out"


@pytest.mark.parametrize("rate", [1000.0, 2000.0, 5000.0, 20_000.0])
def test_the_noise_of_a_fast_board_is_not_what_forces_change_by_in_the_scans_that_are_left_out(rate: float) -> None:
    detector, rng, taxels = TaxelFaultDetector(SENSOR), np.random.default_rng(1), SENSOR.layout.taxels
    described, nowhere = detector.noise_variance.copy(), np.zeros(taxels, np.bool_)
    noise = math.sqrt(described[0]) * SENSOR.volts_per_newton / volts_per_count(SENSOR)
    for block in range(25):
        scan = np.arange(round(0.02 * rate)) + block * round(0.02 * rate)
        ramp = 0x4000 + 5000.0 * noise * scan / rate  # a press that rises: 5 of its deviations in 1 ms
        counts = np.rint(rng.normal(ramp[:, np.newaxis], noise, (len(scan), taxels))).astype(np.uint16)
        for row in counts:
            detector.history.add(row, True)
        detector.measure_noise(0.02, nowhere, nowhere)
    np.testing.assert_array_equal(detector.noise_variance, described)


WARMED_ALONE = [
    [0, 1, 0, 0, 0],
    [0, 0, 0, 0, 0],
    [-6, 1, -3, 0, 0],
    [-4, 94, -8, 0, 0],
    [-2, -9, -1, 0, 0],
]
"""Mean forces under an object that warms the film [mN]: taxel 16 has 157 mN, those around it 41, 53, 15 and 11 mN."""
WARMED_CORNER = [
    [-14, 65, 55, -17, -18],
    [106, 146, 43, 28, -15],
    [166, 225, 58, 35, 47],
    [63, 4, 15, 44, 40],
    [-3, 8, -14, -11, -13],
]
"""Mean forces after several such touches [mN]: taxels 15 and 16 of the square of taxel 20 have 36 and 51 mN."""


@pytest.mark.parametrize(
    ("forces", "taxel", "deviation", "fault"),
    [(WARMED_ALONE, 16, 0.5e-3, TaxelStatus.STUCK), (WARMED_CORNER, 20, 10e-3, TaxelStatus.DEAD)],
)
@pytest.mark.parametrize("warm", [False, True])
def test_neighbours_that_may_be_warm_contradict_no_taxel(
    forces: list[list[int]], taxel: int, deviation: float, fault: TaxelStatus, warm: bool
) -> None:
    """The same forces without negative ones and as certain as at rest are those of a faulty taxel."""
    force = 1e-3 * np.array(forces, np.float64).ravel()
    if not warm:
        force, deviation = np.where(force < 0.0, 0.0, force), 0.5e-3
    detector, random, none = TaxelFaultDetector(SENSOR), np.random.default_rng(3), np.zeros(25, np.bool_)
    noise = SENSOR.adc.noise / volts_per_count(SENSOR)
    for _ in range(30):
        for _ in range(20):
            detector.history.add(np.rint(REST + random.normal(0.0, noise, 25)).astype(np.uint16), True)
        variance = np.full(25, deviation**2)
        detector.close_block(0.02, force, variance, 0.0 * force, none, force > 0.02, ~none)
    assert detector.status[taxel] == (TaxelStatus.OK if warm else fault)


@pytest.mark.parametrize("known", [True, False])
def test_an_unknown_offset_is_no_fault_of_a_taxel_or_its_neighbours(known: bool) -> None:
    """The force of a taxel whose offset is unknown says nothing of those around it, nor they of it."""
    detector, middle, block = TaxelFaultDetector(SENSOR), LAYOUT.taxels // 2, 20
    unknown = np.arange(LAYOUT.taxels) == middle
    force = np.where(unknown, 0.4, 0.002)  # far more than its neighbours would feel of so large a force
    rng, deviation = np.random.default_rng(3), SENSOR.adc.noise / volts_per_count(SENSOR)
    quiet, nothing, all_taxels = np.full(LAYOUT.taxels, 1e-8), np.zeros(LAYOUT.taxels), np.ones(LAYOUT.taxels, np.bool_)
    for _ in range(30):
        for _ in range(block):
            detector.history.add(np.round(REST + rng.normal(0, deviation, LAYOUT.taxels)).astype(np.uint16), True)
        detector.close_block(0.02, force, quiet, nothing, ~all_taxels, all_taxels, ~unknown | known)
    assert np.array_equal(detector.faulty, unknown & known)


def vibrating(share: float, time: float) -> float:
    return press(1.5, 0.5, 2.5)(time) * (1.0 + share * math.sin(2 * math.pi * 200 * time))


def test_vibration_under_a_fingertip_is_not_noise() -> None:
    for place, share in (((0.0, 0.0), 0.3), ((3e-3, 3e-3), 0.3), ((1.5e-3, 0.0), 0.004), ((0.0, 0.0), 0.01)):
        wave = functools.partial(vibrating, share)
        _, _, statuses = run(lambda index, scan: None, 2.5, wave, finger(*place))
        assert not np.any(statuses)
