# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Crosstalk compensation, verified against the dense inverse, and non-negative forces, against an exact solver."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.reconstruction import reconstructor as reconstruction
from posfet_model.reconstruction.force_image import non_negative
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Layout, load_sensor
from posfet_model.sensor.grid import ALL_NEIGHBOURS, dilate, neighbour_table
from reference.active_set import solve
from reference.dense_pressure import sphere_forces
from support.scan_player import press, scans

SENSOR = load_sensor()
NOISE = 0.35e-3


def mixing(rows: int, cols: int, share: float) -> np.ndarray:
    """Return the dense crosstalk matrix: the response of each taxel to the force on every taxel."""
    matrix = np.eye(rows * cols)
    for taxel in range(rows * cols):
        row, col = divmod(taxel, cols)
        for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
            if 0 <= r < rows and 0 <= c < cols:
                matrix[taxel, r * cols + c] = share
    return matrix


def layout(rows: int, cols: int) -> Layout:
    return Layout(1, rows, cols, 1.5e-3, 1.5e-3, 1e-6)


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 6), (5, 5), (4, 7), (9, 8), (16, 16), (3, 40)])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.02, 0.05, 0.12])
def test_compensation_equals_the_dense_inverse(rows: int, cols: int, share: float) -> None:
    true = np.random.default_rng(1).normal(size=rows * cols)
    compensated = CrosstalkCompensator(layout(rows, cols), share).apply(mixing(rows, cols, share) @ true)
    np.testing.assert_allclose(compensated, true, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("rows", "cols"), [(5, 5), (20, 20)])
def test_no_pattern_is_amplified_more_than_twice(rows: int, cols: int) -> None:
    inverse = CrosstalkCompensator(layout(rows, cols), 0.2)
    dense = np.stack([inverse.apply(unit) for unit in np.eye(rows * cols)])
    assert np.linalg.norm(dense, 2) <= 2.0 + 1e-9
    assert np.linalg.norm(np.linalg.inv(mixing(rows, cols, 0.2)), 2) > 2.5


def test_a_crosstalk_share_out_of_range_is_rejected() -> None:
    with pytest.raises(ValueError, match="share"):
        CrosstalkCompensator(layout(2, 2), 0.3)


@given(
    st.lists(st.floats(-1.0, 3.0), min_size=1, max_size=30),
    st.lists(st.floats(0.01, 100.0), min_size=30, max_size=30),
)
def test_non_negative_forces_equal_those_of_the_exact_solver(forces: list[float], many: list[float]) -> None:
    force, variance = np.array(forces), np.array(many[: len(forces)])
    nearest = non_negative(force, variance)
    assert nearest.min() >= 0.0
    if force.sum() > 1e-6:
        assert nearest.sum() == pytest.approx(force.sum(), abs=1e-9)
        exact = solve(np.diag(variance**-0.5), force, float(force.sum()))
        np.testing.assert_allclose(nearest, exact, rtol=0, atol=1e-7)


def test_non_negative_forces_stay_unchanged() -> None:
    force = np.array([0.0, 0.1, 2.0])
    np.testing.assert_array_equal(non_negative(force, np.ones(3)), force)
    np.testing.assert_array_equal(non_negative(-force, np.ones(3)), np.zeros(3))


@pytest.mark.parametrize("share", [0.02, 0.05])
@pytest.mark.parametrize("wrong", [1.0, 0.5, 1.5])
def test_compensation_with_non_negativity_approximates_non_negative_least_squares(share: float, wrong: float) -> None:
    """Against non-negative least squares with the mixing matrix itself, also with a wrong crosstalk share."""
    rng = np.random.default_rng(7)
    force = sphere_forces(0.3e-3, -0.2e-3, 0.3, 1.5e-3, 8e6, SENSOR.device.contact_spread, 1.5e-3, 5)
    assumed = share * wrong
    inverse = CrosstalkCompensator(layout(5, 5), assumed)
    before, after = 0.0, 0.0
    for _ in range(50):
        shown = mixing(5, 5, share) @ force + rng.normal(0, NOISE, 25)
        linear = inverse.apply(shown)
        fast = non_negative(linear, np.full(25, NOISE**2))
        exact = solve(mixing(5, 5, assumed), linear, float(linear.sum()))
        below = -float(linear.min())
        assert np.abs(fast - exact).max() <= 8.0 * assumed * below  # 2*c of each of four neighbours
        before += float(((linear - force) ** 2).sum())
        after += float(((fast - force) ** 2).sum())
    if wrong <= 1.0:  # else too much is subtracted from the neighbours, which the constraint cannot correct
        assert after < before


def test_a_map_is_non_negative_around_a_contact_and_keeps_its_total(monkeypatch: pytest.MonkeyPatch) -> None:
    reconstructor, neighbours = Reconstructor(SENSOR), neighbour_table(SENSOR.layout, ALL_NEIGHBOURS)
    shape = sphere_forces(0.3e-3, -0.2e-3, 1.0, 1.5e-3, 8e6, SENSOR.device.contact_spread, 1.5e-3, 5)
    below = 0
    for time, scan in scans(SENSOR, 0.6, force=press(0.5, 0.3, 9.0), shape=shape):
        result = reconstructor.process(scan)
        if time >= 0.35:
            image = copy.deepcopy(reconstructor.image())
            with monkeypatch.context() as unprojected:
                unprojected.setattr(reconstruction, "non_negative", lambda force, _: force)
                below += int((reconstructor.image().force < 0).sum())
            [contact] = result.contacts
            patch = dilate(np.isin(np.arange(SENSOR.layout.taxels), contact.region.taxels), neighbours)
            assert patch.sum() >= 16
            assert image.force[patch].min() >= 0.0
            assert image.total == pytest.approx(float(image.force.sum()), abs=1e-5)
    assert below > 100
