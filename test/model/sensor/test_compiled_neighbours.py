# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled interpolation from neighbours equals the plain reference in Python."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.neighbour_estimate import (
    INTERPOLATION_UNCERTAINTY,
    NeighbourInterpolation,
    most_over_neighbours,
)
from reference import neighbour_estimate as reference
from reference.dense_pressure import sphere_forces

SENSOR = load_sensor()
LAYOUT = SENSOR.layout


@given(
    st.integers(1, 64),
    st.integers(1, 64),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.1, 0.6, 1.0]),
    st.sampled_from([0.0, 1e-3, 0.3]),
)
def test_estimates_equal_those_of_the_reference(rows: int, cols: int, seed: int, unknown: float, floor: float) -> None:
    layout, random = replace(LAYOUT, rows=rows, cols=cols), np.random.default_rng(seed)
    compiled, plain = NeighbourInterpolation(layout), reference.NeighbourInterpolation(layout)
    force = random.choice([1.0, 1e-2, 0.0, math.nan], layout.taxels, p=[0.6, 0.2, 0.15, 0.05])
    force *= random.uniform(-0.2, 1.0, layout.taxels)
    force += 0.0  # no -0.0: NumPy does not say which zero is the greater one
    hidden, wanted = random.random(layout.taxels) < unknown, random.permutation(layout.taxels)[: 1 + seed % 50]
    for name, more in (("interpolate", random.choice([0.5, 3.0, 7.5, math.inf], 2).tolist()), ("lower_bound", [])):
        found = getattr(compiled, name)(force, hidden, wanted, floor, *more)
        expected = getattr(plain, name)(force, hidden, wanted, floor, *more)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(compiled.max_neighbour(force), plain.max_neighbour(force))


def test_a_taxel_that_does_not_exist_is_refused() -> None:
    none = np.zeros(LAYOUT.taxels, np.bool_)
    for taxel in (-1, LAYOUT.taxels):
        with pytest.raises(IndexError, match="wanted must have indices of taxels"):
            NeighbourInterpolation(LAYOUT).interpolate(np.zeros(LAYOUT.taxels), none, [taxel], 0.0, math.inf, math.inf)


def test_a_corner_is_limited_to_what_a_point_load_on_it_would_let_its_neighbours_feel() -> None:
    force = np.zeros(LAYOUT.taxels)
    force[[1, LAYOUT.cols]] = 44e-3, 58e-3
    none, most = np.zeros(LAYOUT.taxels, np.bool_), most_over_neighbours(SENSOR)
    assert most == pytest.approx((1.0 / 0.1338, 1.0 / 0.1338), rel=1e-3)
    [found], [deviation] = NeighbourInterpolation(LAYOUT).interpolate(force, none, [0], 1.7e-3, *most)
    assert found == pytest.approx(58e-3 * most[1])  # 44 mN * 58 mN / 1.7 mN are 1.5 N
    assert deviation == found
    force[LAYOUT.cols + 1] = 30e-3
    [found], [deviation] = NeighbourInterpolation(LAYOUT).interpolate(force, none, [0], 1.7e-3, *most)
    assert found == pytest.approx(44e-3 * 58e-3 / 30e-3)
    errors = np.hypot.reduce([INTERPOLATION_UNCERTAINTY, 1.7 / 44.0, 1.7 / 58.0, 1.7 / 30.0])
    assert deviation == pytest.approx(found * errors)


@pytest.mark.parametrize("angle", [0.3, 0.8, 2.2])
def test_a_bar_at_an_angle_is_interpolated_in_the_middle_at_an_edge_and_in_a_corner(angle: float) -> None:
    """Its forces are 0.3 N at most; along it they decline as far as the squares reach."""
    cells, none = np.arange(LAYOUT.taxels), np.zeros(LAYOUT.taxels, np.bool_)
    col, row = cells % LAYOUT.cols, cells // LAYOUT.cols
    for at_col, at_row, taxel in ((2.2, 1.9, 12), (0.4, 2.1, 10), (0.6, 0.3, 0)):
        along = (col - at_col) * math.cos(angle) + (row - at_row) * math.sin(angle)
        across = (row - at_row) * math.cos(angle) - (col - at_col) * math.sin(angle)
        force = 0.3 * np.exp(-0.5 * (along / 2.5) ** 2 - 0.5 * across**2)
        [found], _ = NeighbourInterpolation(LAYOUT).interpolate(
            force, none, [taxel], 1.7e-3, *most_over_neighbours(SENSOR)
        )
        assert abs(found - force[taxel]) < 0.1 * force[taxel]


@pytest.mark.slow
def test_an_extrapolation_is_about_as_uncertain_as_it_is_large() -> None:
    random, surroundings, none = np.random.default_rng(5), NeighbourInterpolation(LAYOUT), np.zeros(25, np.bool_)
    cells, pitch, spread = np.arange(25), LAYOUT.pitch_x, SENSOR.device.contact_spread
    errors: list[float] = []
    for _ in range(240):  # half of them beside the centres of the outermost cells
        x, y = random.uniform(-4e-3, 4e-3, 2)
        force = sphere_forces(x, y, random.choice([0.1, 0.5]), random.choice([1.5e-3, 6e-3]), 2e6, spread, pitch, 5)
        read = force * random.normal(1.0, 0.05, 25) + random.normal(0.0, 0.35e-3, 25)
        found, deviation = surroundings.interpolate(read, none, cells, 1.7e-3, *most_over_neighbours(SENSOR))
        counts = (found > SENSOR.contact.threshold) & (deviation > 0.5 * found)
        errors += ((found - force)[counts] / deviation[counts]).tolist()
    assert len(errors) > 50
    assert np.mean(np.abs(errors) < 2.0) >= 0.8  # of 20 % of the force: 0.3


@pytest.mark.slow
def test_under_a_ring_squares_disagree_and_say_so() -> None:
    # With the uncertainty under a fingertip alone, 23 % of these errors are within two deviations.
    random, surroundings, none = np.random.default_rng(6), NeighbourInterpolation(LAYOUT), np.zeros(25, np.bool_)
    cells, pitch, spread = np.arange(25), LAYOUT.pitch_x, SENSOR.device.contact_spread
    errors: list[float] = []
    for _ in range(40):
        x, y = random.uniform(-0.5e-3, 0.5e-3, 2)
        force = np.zeros(25)
        for angle in np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False):
            at = x + 2.5e-3 * math.cos(angle), y + 2.5e-3 * math.sin(angle)
            force += sphere_forces(*at, 1.5 / 24, 1.5e-3, 2e6, spread, pitch, 5)
        found, deviation = surroundings.interpolate(force, none, cells, 1.7e-3, *most_over_neighbours(SENSOR))
        counts = force > 0.02 * force.sum()
        errors += ((found - force)[counts] / deviation[counts]).tolist()
    assert len(errors) > 400
    assert np.mean(np.abs(errors) < 2.0) >= 0.75
