# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Shares of a point force under the elastomer skin, compared with the normal distribution of the standard library."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_sim.contact.cell_table import GAUSSIAN_REACH, Workspace, cell_table

CELLS = 6
ACCURACY = 2.4e-7


def share(position: float, cell: int, pitch: float, spread: float) -> float:
    """Return the share of a force at `position` [m] that a cell receives."""
    skin = NormalDist(position, spread)
    return skin.cdf((cell + 1) * pitch) - skin.cdf(cell * pitch)


@given(st.floats(0.3e-3, 3e-3), st.floats(0.2, 3.0), st.lists(st.floats(-3.0, 9.0), min_size=1, max_size=4))
def test_each_cell_receives_its_part_of_the_gaussian(pitch: float, width: float, places: list[float]) -> None:
    spread = width * pitch
    positions = np.array(places) * pitch
    found = cell_table(pitch, spread).collect(positions, CELLS, Workspace())
    assert found.shape == (CELLS, len(places))
    for column, position in enumerate(positions):
        expected = [share(position, cell, pitch, spread) for cell in range(CELLS)]
        np.testing.assert_allclose(found[:, column], expected, rtol=0, atol=ACCURACY)


@given(st.floats(0.3e-3, 3e-3), st.floats(0.05, 0.4), st.floats(2.7, 3.3))
def test_cells_beyond_the_reach_on_both_sides_share_the_whole_force(pitch: float, width: float, place: float) -> None:
    found = cell_table(pitch, width * pitch).collect(np.array([place * pitch]), CELLS, Workspace())
    assert found.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("beyond", [1.001, 5.0, 1e3])
def test_a_force_out_of_reach_gives_exactly_nothing(beyond: float) -> None:
    pitch, spread = 1e-3, 0.6e-3
    away = beyond * GAUSSIAN_REACH * spread
    table = cell_table(pitch, spread)
    found = table.collect(np.array([-away, CELLS * pitch + away]), CELLS, Workspace())
    assert (found == 0.0).all()
    inside = table.collect(np.array([-0.99 * GAUSSIAN_REACH * spread]), CELLS, Workspace())
    assert inside[0, 0] > 0.0


def test_cells_share_alike_left_and_right_of_the_force() -> None:
    pitch = 1e-3
    found = cell_table(pitch, 0.7e-3).collect(np.array([2.2, 3.8]) * pitch, CELLS, Workspace())
    np.testing.assert_allclose(found[:, 0], found[::-1, 1], rtol=0, atol=1e-12)


def test_positions_of_any_shape_keep_it_and_are_not_changed() -> None:
    positions = np.linspace(0.0, 6e-3, 24).reshape(2, 3, 4)
    before = positions.copy()
    table = cell_table(1e-3, 0.6e-3)
    found = table.collect(positions, CELLS, Workspace())
    assert found.shape == (CELLS, 2, 3, 4)
    np.testing.assert_array_equal(positions, before)
    flat = table.collect(positions.ravel(), CELLS, Workspace())
    np.testing.assert_array_equal(found.reshape(CELLS, -1), flat)


def test_a_result_outlives_the_next_use_of_the_workspace() -> None:
    table, work = cell_table(1e-3, 0.6e-3), Workspace()
    first = table.collect(np.array([2e-3]), CELLS, work)
    kept = first.copy()
    table.collect(np.array([4e-3, 5e-3]), CELLS, work)
    np.testing.assert_array_equal(first, kept)
