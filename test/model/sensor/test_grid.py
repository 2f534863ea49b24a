# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Neighbour tables of the taxel grid, against the definition by rows and columns."""

import numpy as np
import pytest

from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import (
    ALL_NEIGHBOURS,
    CORNER_NEIGHBOURS,
    EDGE_NEIGHBOURS,
    dilate,
    neighbour_lists,
    neighbour_table,
)
from reference.contacts.corners import opposite_corners

SHAPES = ((1, 1), (1, 6), (6, 1), (2, 2), (3, 5), (8, 7))


def layout(rows: int, cols: int) -> Layout:
    return Layout(1, rows, cols, 1e-3, 1e-3, 1e-6)


@pytest.mark.parametrize(("rows", "cols"), SHAPES)
@pytest.mark.parametrize("offsets", (EDGE_NEIGHBOURS, CORNER_NEIGHBOURS, ALL_NEIGHBOURS, ((0, 1),)))
def test_table_and_lists_follow_the_offsets(rows: int, cols: int, offsets: tuple[tuple[int, int], ...]) -> None:
    table = neighbour_table(layout(rows, cols), offsets)
    assert table.shape == (rows * cols, len(offsets))
    for taxel in range(rows * cols):
        row, col = divmod(taxel, cols)
        places = [(row + down, col + right) for down, right in offsets]
        expected = [r * cols + c if 0 <= r < rows and 0 <= c < cols else rows * cols for r, c in places]
        assert table[taxel].tolist() == expected
        assert neighbour_lists(layout(rows, cols), offsets)[taxel] == [
            index for index in expected if index < rows * cols
        ]


def test_edge_and_corner_neighbours_are_all_neighbours() -> None:
    assert sorted(ALL_NEIGHBOURS) == sorted(EDGE_NEIGHBOURS + CORNER_NEIGHBOURS)
    assert len(set(ALL_NEIGHBOURS)) == 8


@pytest.mark.parametrize(("rows", "cols"), SHAPES)
def test_diagonal_neighbours_complete_a_square(rows: int, cols: int) -> None:
    pairs = opposite_corners(layout(rows, cols))
    assert len(pairs) == 4 * (rows - 1) * (cols - 1)
    for pair, others in pairs.items():
        assert pairs[pair[::-1]] == others
        whole = sorted(divmod(taxel, cols) for taxel in pair + others)
        row, col = whole[0]
        assert whole == [(row, col), (row, col + 1), (row + 1, col), (row + 1, col + 1)]
        assert divmod(pair[0], cols)[0] != divmod(pair[1], cols)[0]
        assert divmod(pair[0], cols)[1] != divmod(pair[1], cols)[1]


@pytest.mark.parametrize(("rows", "cols"), SHAPES)
@pytest.mark.parametrize("offsets", (EDGE_NEIGHBOURS, ALL_NEIGHBOURS))
def test_dilate_adds_the_neighbours(rows: int, cols: int, offsets: tuple[tuple[int, int], ...]) -> None:
    mask = np.random.default_rng(rows * 10 + cols).random(rows * cols) < 0.2
    lists = neighbour_lists(layout(rows, cols), offsets)
    expected = [bool(mask[taxel] or any(mask[lists[taxel]])) for taxel in range(rows * cols)]
    assert dilate(mask, neighbour_table(layout(rows, cols), offsets)).tolist() == expected
