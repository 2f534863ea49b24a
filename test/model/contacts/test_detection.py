# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Regions, centre of pressure and contacts, verified against dense pressure and a plain flood fill."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_model.contacts.detection import ContactFinder, ForceEstimate, Region
from posfet_model.sensor.description import Sensor, load_sensor
from reference.dense_pressure import sphere_forces

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
NOISE = 0.35e-3
VARIANCE = np.full(LAYOUT.taxels, NOISE**2)


def flood_fill(mask: NDArray[np.bool_]) -> list[list[int]]:
    """Return the 8-connected components of a map, by flood fill."""
    cols = mask.shape[1]
    left = {(int(r), int(c)) for r, c in np.argwhere(mask)}
    regions = []
    while left:
        todo, region = [min(left)], []
        left.discard(todo[0])
        while todo:
            row, col = todo.pop()
            region.append(row * cols + col)
            near = {(row + i, col + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & left
            left -= near
            todo += near
        regions.append(sorted(region))
    return regions


def masks(rows: int, cols: int) -> st.SearchStrategy[NDArray[np.bool_]]:
    flags = st.lists(st.booleans(), min_size=rows * cols, max_size=rows * cols)
    return flags.map(lambda each: np.array(each, np.bool_))


def of_size(rows: int, cols: int) -> Sensor:
    """Return the sensor with an array of another size."""
    return replace(SENSOR, layout=replace(LAYOUT, rows=rows, cols=cols))


@given(st.integers(1, 12), st.integers(1, 12), st.data())
def test_regions_equal_those_of_a_flood_fill(rows: int, cols: int, data: st.DataObject) -> None:
    mask = data.draw(masks(rows, cols))
    sensor = of_size(rows, cols)
    regions = find(mask * 1.0, sensor)
    wanted = flood_fill(mask.reshape(rows, cols))
    listed = sorted(taxel for region in regions for taxel in region.taxels.tolist())
    assert listed == sorted(taxel for region in wanted for taxel in region)
    for region in regions:  # separation may divide a region, and joins none
        assert [set(region.taxels.tolist()) <= set(other) for other in wanted].count(True) == 1
        places = sensor.layout.positions[region.taxels]
        np.testing.assert_allclose(region.geometric_centre, places.mean(axis=0), rtol=0, atol=1e-12)


@given(st.integers(1, 9), st.integers(1, 9), st.data())
def test_patches_are_regions_and_neighbours_of_only_one_region(rows: int, cols: int, data: st.DataObject) -> None:
    mask = data.draw(masks(rows, cols))
    finder, regions = ContactFinder(of_size(rows, cols)), flood_fill(mask.reshape(rows, cols))
    find(mask * 1.0, of_size(rows, cols), finder)

    def near(taxel: int) -> list[int]:
        """Return the indices of the regions that a taxel belongs to or borders on."""
        row, col = divmod(taxel, cols)
        reach = {(row + i) * cols + col + j for i in (-1, 0, 1) for j in (-1, 0, 1) if 0 <= col + j < cols}
        return [number for number, region in enumerate(regions) if reach & set(region)]

    for number, patch in enumerate(finder.patches):
        around = [taxel for taxel in range(rows * cols) if near(taxel) == [number]]
        assert patch.tolist() == sorted({*regions[number], *around})
    assert len(finder.patches) == len(regions)


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 5), st.data())
def test_dilation_reaches_along_rows_columns_and_diagonals_and_stops_at_the_edges(
    rows: int, cols: int, distance: int, data: st.DataObject
) -> None:
    mask = data.draw(masks(rows, cols))
    row, col = np.divmod(np.arange(rows * cols), cols)
    apart = np.maximum(abs(row[:, None] - row), abs(col[:, None] - col))
    expected = (apart[:, mask] <= distance).any(axis=1)
    np.testing.assert_array_equal(ContactFinder(of_size(rows, cols)).dilated(mask, distance), expected)


def find(
    forces: NDArray[Any], sensor: Sensor = SENSOR, finder: ContactFinder | None = None, **more: Any
) -> list[Region]:
    finder = finder or ContactFinder(sensor)
    variance = np.full(sensor.layout.taxels, NOISE**2)
    finder.update_thresholds(forces, variance, duration=more.get("block", 0.02))
    taxels = ForceEstimate(forces, variance, more.get("saturated"), correlated_error=more.get("correlated_error"))
    finder.find(forces)
    return list(finder.measure(taxels))


def sphere(x: float, y: float, force: float, radius: float = 6e-3, modulus: float = 1e6) -> NDArray[np.float64]:
    return sphere_forces(x, y, force, radius, modulus, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)


PLACES = [(0, 0), (0.4, 0.3), (0.75, -0.75), (1.5, 0), (2.25, 0.7), (-2.6, 0), (0, 3), (3, 1.1), (2, -2), (-3, -3)]


@pytest.mark.parametrize("force", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(("radius", "modulus"), [(6e-3, 1e6), (4e-3, 5e6)])
def test_centre_of_pressure_of_a_sphere_anywhere_on_the_array(force: float, radius: float, modulus: float) -> None:
    errors = {}
    noise = np.random.default_rng(2).normal(0, NOISE, LAYOUT.taxels)
    for x, y in PLACES:
        [region] = find(sphere(x * 1e-3, y * 1e-3, force, radius, modulus) + noise)
        errors[x, y] = math.dist(region.centre_of_pressure, (x * 1e-3, y * 1e-3))
    inside = [error for (x, y), error in errors.items() if max(abs(x), abs(y)) <= 1.5]
    assert max(inside) < 0.07e-3, errors
    assert max(errors.values()) < 0.3e-3, errors


def test_a_slide_is_tracked_without_jumps_when_taxels_enter_and_leave() -> None:
    track = np.linspace(-1.5e-3, 1.5e-3, 41)
    errors = [find(sphere(x, 0.2e-3, 0.5))[0].centre_of_pressure[0] - x for x in track]
    assert np.abs(np.diff(errors)).max() < 0.015e-3


def test_contact_force_equals_the_force_of_the_sphere() -> None:
    for force in (0.5, 2.0):
        [region] = find(sphere(0.2e-3, -0.3e-3, force))
        assert region.force == pytest.approx(force, rel=0.015)


def test_all_properties_of_a_region() -> None:
    forces = np.zeros(LAYOUT.taxels)
    forces[[11, 12, 13]] = 0.1, 0.3, 0.1
    [region] = find(forces, correlated_error=np.full((LAYOUT.taxels, 1), 1e-3))
    assert region.taxels.tolist() == [11, 12, 13]
    assert region.centre_of_pressure == pytest.approx((0, 0), abs=1e-12)
    assert region.geometric_centre == pytest.approx((0, 0), abs=1e-12)
    assert region.force == pytest.approx(0.5, abs=1e-12)
    assert region.force_variance == pytest.approx(3 * NOISE**2 + 9e-6, rel=1e-9)
    assert region.area == pytest.approx(3 * 2.25e-6, rel=1e-12)
    assert region.peak_pressure == pytest.approx(0.3 / 1e-6, rel=1e-12)
    # Variance along x: 2*0.1*1.5^2/0.5 mm2.
    assert region.major_axis == pytest.approx((math.sqrt(0.9) * 1e-3, 0), abs=1e-9)
    assert region.minor_axis == pytest.approx((0, 0), abs=1e-9)


def test_centre_of_pressure_and_geometric_centre_differ_for_uneven_force() -> None:
    forces = np.zeros(LAYOUT.taxels)
    forces[[11, 12]] = 0.1, 0.3
    [region] = find(forces)
    assert region.geometric_centre[0] == pytest.approx(-0.75e-3, abs=1e-9)
    assert region.centre_of_pressure[0] == pytest.approx(-0.375e-3, abs=1e-9)


def test_a_saturated_taxel_leaves_peak_and_variance_unknown() -> None:
    saturated = np.zeros(LAYOUT.taxels, np.bool_)
    saturated[12] = True
    [region] = find(sphere(0, 0, 2.0), saturated=saturated)
    assert math.isnan(region.peak_pressure)
    assert math.isnan(region.force_variance)
    assert region.force > 0


def test_hysteresis_keeps_a_contact_between_the_thresholds() -> None:
    finder = ContactFinder(SENSOR)
    forces = np.zeros(LAYOUT.taxels)
    counts = []
    for newton in (0.015, 0.021, 0.015, 0.011, 0.009, 0.015):
        forces[12] = newton
        counts.append(len(find(forces, finder=finder)))
    assert counts == [0, 1, 1, 1, 0, 0]


def test_thresholds_rise_with_the_uncertainty_of_the_force() -> None:
    finder = ContactFinder(SENSOR)
    forces = np.full(LAYOUT.taxels, 0.03)
    finder.update_thresholds(forces, VARIANCE + 0.01**2)
    assert not finder.find(forces)
    finder.update_thresholds(forces, VARIANCE)
    assert finder.find(forces) == 1


def test_a_held_contact_lasts_despite_high_uncertainty_and_ends_on_release() -> None:
    finder = ContactFinder(SENSOR)
    forces = np.zeros(LAYOUT.taxels)
    forces[12] = 0.3
    assert len(find(forces, finder=finder)) == 1
    for deviation in np.linspace(0.0, 0.2, 100):
        forces[12] -= 0.001  # baseline drift in the meantime
        finder.update_thresholds(forces, np.full(LAYOUT.taxels, deviation**2))
        assert finder.find(forces) == 1
    forces[12] -= 0.15
    assert not finder.find(forces)


@pytest.mark.parametrize("block", [0.02, 0.05, 0.1])
def test_residual_hysteresis_after_a_strong_touch_is_no_contact_and_expires(block: float) -> None:
    """After five seconds at any scan rate: with fewer than 50 scans per second a block has one."""
    finder = ContactFinder(SENSOR)
    forces = np.zeros(LAYOUT.taxels)
    expires = round(5.0 / block)
    for newton, blocks, contacts in ((2.0, 1, 1), (0.03, 2, 0), (0.05, 1, 1), (0.03, 1, 0), (0.03, expires, 1)):
        forces[12] = newton
        for _ in range(blocks):
            found = find(forces, finder=finder, block=block)
        assert len(found) == contacts, (newton, blocks)


def test_unusable_taxels_belong_to_no_contact() -> None:
    finder = ContactFinder(SENSOR)
    usable = np.ones(LAYOUT.taxels, np.bool_)
    usable[12] = False
    forces = sphere(0, 0, 1.0)
    finder.update_thresholds(forces, VARIANCE, usable)
    assert finder.find(forces) == 1
    [region] = finder.measure(ForceEstimate(forces, VARIANCE))
    assert 12 not in region.taxels
    assert region.force < 1.0 - forces[12] + 0.01


def test_a_touch_on_a_noisy_taxel_continues_on_lower_neighbour_forces_than_at_onset() -> None:
    finder, forces = ContactFinder(SENSOR), np.zeros(LAYOUT.taxels)
    finder.update_thresholds(forces, np.full(LAYOUT.taxels, 3e-3**2))
    taxels = ForceEstimate(forces, VARIANCE, unlisted=np.arange(LAYOUT.taxels) == 12)
    forces[12] = 0.05
    found: list[Region] = []
    counts = []
    for beside in (6e-3, 9e-3, 6e-3, 3e-3, 6e-3):
        forces[13] = beside
        finder.find(forces)
        found = list(finder.measure(taxels, found))
        counts.append(len(found))
    assert counts == [0, 1, 1, 0, 0]


def test_a_force_being_released_counts_as_touched() -> None:
    finder, forces = ContactFinder(SENSOR), np.zeros(LAYOUT.taxels)
    touched = []
    for force in (0.1, 0.09, 0.008, 0.004, 0.003, 0.003):
        forces[12] = force
        finder.find(forces)
        touched.append(bool(finder.touched[12]))
        finder.update_thresholds(forces, VARIANCE)
    assert touched == [True, True, True, True, True, False]


def test_two_contacts_stay_separate_and_share_no_taxel() -> None:
    forces = np.zeros(LAYOUT.taxels)
    forces[[0, 1, 5]] = 0.2, 0.1, 0.1
    forces[[24, 23, 18]] = 0.4, 0.1, 0.2
    first, second = find(forces)
    assert first.taxels.tolist() == [0, 1, 5]
    assert second.taxels.tolist() == [18, 23, 24]
    assert first.force == pytest.approx(0.4, abs=1e-12)
    assert second.force == pytest.approx(0.7, abs=1e-12)


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 7), (2, 2), (9, 4), (32, 32)])
def test_any_layout_is_accepted(rows: int, cols: int) -> None:
    sensor = replace(SENSOR, layout=replace(LAYOUT, rows=rows, cols=cols))
    for taxel in {0, rows * cols // 2, rows * cols - 1}:
        forces = np.zeros(rows * cols)
        forces[taxel] = 1.0
        [region] = find(forces, sensor)
        assert region.taxels.tolist() == [taxel]
        apart = np.abs(np.array(region.centre_of_pressure) - sensor.layout.positions[taxel])
        assert apart.max() <= 0.75e-3 + 1e-12  # within the taxel's cell


@given(st.floats(0.3, 3.0), st.floats(0.3, 3.0), st.floats(0, math.pi))
def test_principal_axes_equal_those_of_a_rotated_ellipse(long: float, short: float, angle: float) -> None:
    """A Gaussian in the middle of a large array, sampled finely enough."""
    sensor = of_size(41, 41)
    x, y = (sensor.layout.positions / LAYOUT.pitch_x).T
    along, across = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
    long, short = 1.0 + max(long, short), 1.0 + min(long, short)
    forces = 100.0 * np.exp(-0.5 * ((along / long) ** 2 + (across / short) ** 2))
    finder = ContactFinder(sensor)
    [region] = find(forces, sensor, finder)
    counts = finder.dilated(forces >= SENSOR.contact.threshold, 1) & (forces > 2.5 * NOISE)
    counted = np.where(counts, forces, 0.0)
    moments = np.cov(sensor.layout.positions.T, aweights=counted, ddof=0)
    major, minor = np.array(region.major_axis), np.array(region.minor_axis)
    assert major[0] >= 0
    assert major @ minor == pytest.approx(0.0, abs=1e-15)
    assert major[0] * minor[1] >= major[1] * minor[0]
    np.testing.assert_allclose(np.outer(major, major) + np.outer(minor, minor), moments, rtol=0, atol=1e-13)


@given(st.lists(st.floats(0.021, 5.0), min_size=25, max_size=25))
def test_moments_of_arbitrary_forces_are_finite_and_near_the_array(values: list[float]) -> None:
    for region in find(np.array(values)):
        assert all(
            math.isfinite(value) for value in (*region.centre_of_pressure, *region.major_axis, *region.minor_axis)
        )
        assert max(abs(value) for value in region.centre_of_pressure) <= 3.75e-3 + 1e-12


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ((np.zeros(24), VARIANCE), "variance must have one value for each of 24 taxels"),
        ((np.zeros(0), np.zeros(0)), "there must be at least one taxel"),
        ((np.zeros(25), VARIANCE, np.zeros(5, np.bool_)), "saturated must have one value for each of 25 taxels"),
    ],
)
def test_arrays_of_another_size_are_refused(arguments: tuple[Any, ...], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        ForceEstimate(*arguments)


def test_forces_of_another_array_or_type_are_refused() -> None:
    finder = ContactFinder(SENSOR)
    with pytest.raises(ValueError, match="force must have one value for each of 25 taxels"):
        finder.find(np.zeros(16))
    with pytest.raises(ValueError, match="force must have one value for each of 25 taxels"):
        finder.measure(ForceEstimate(np.zeros(16), np.zeros(16)))
    with pytest.raises(TypeError):  # kept by reference: a copy would not follow the forces
        ForceEstimate(np.zeros(25, np.float32), VARIANCE)  # type: ignore[arg-type]
