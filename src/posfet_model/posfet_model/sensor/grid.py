# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Neighbours on the grid of taxels, by index: the only place where neighbour tables are built.

Taxels are numbered row by row. A neighbour that would lie outside the array gets the index `rows * cols`, one behind
the last taxel, so that a table can index values to which one value for "outside" has been appended.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model._lib.types import Mask
from posfet_model.sensor.description import Layout

Offset: TypeAlias = "tuple[int, int]"
"""Rows and columns from a taxel to its neighbour."""

EDGE_NEIGHBOURS: Final[tuple[Offset, ...]] = ((-1, 0), (1, 0), (0, -1), (0, 1))
"""Offsets of the four neighbours that share an edge with a taxel."""

CORNER_NEIGHBOURS: Final[tuple[Offset, ...]] = ((-1, -1), (-1, 1), (1, -1), (1, 1))
"""Offsets of the four neighbours that share only a corner with a taxel."""

ALL_NEIGHBOURS: Final[tuple[Offset, ...]] = (
    *((-1, right) for right in (-1, 0, 1)),
    *((0, right) for right in (-1, 1)),
    *((1, right) for right in (-1, 0, 1)),
)
"""Offsets of all eight neighbours, row by row."""


def neighbour_table(layout: Layout, offsets: Sequence[Offset]) -> NDArray[np.intp]:
    """Return the index of each taxel's neighbour at each offset.

    Parameters
    ----------
    layout : Layout
        The array.
    offsets : sequence of tuple of int
        Rows and columns to each neighbour, each -1, 0 or 1.

    Returns
    -------
    ndarray
        Indices, shape [rows * cols, offsets]; `rows * cols` where the neighbour lies outside the array.

    Examples
    --------
    >>> neighbour_table(Layout(1, 2, 3, 1e-3, 1e-3, 1e-6), EDGE_NEIGHBOURS).tolist()[4]
    [1, 6, 3, 5]
    """
    padded = np.full((layout.rows + 2, layout.cols + 2), layout.taxels, np.intp)
    padded[1:-1, 1:-1] = np.arange(layout.taxels).reshape(layout.rows, layout.cols)
    shifted = [
        padded[1 + down : 1 + down + layout.rows, 1 + right : 1 + right + layout.cols].reshape(-1)
        for down, right in offsets
    ]
    return np.stack(shifted, axis=1)


def neighbour_lists(layout: Layout, offsets: Sequence[Offset]) -> list[list[int]]:
    """Return for each taxel the indices of those of its neighbours that lie on the array.

    Parameters
    ----------
    layout : Layout
        The array.
    offsets : sequence of tuple of int
        Rows and columns to each neighbour, each -1, 0 or 1.

    Returns
    -------
    list of list of int
        Indices of the neighbours of each taxel, in the order of `offsets`.
    """
    return [
        [neighbour for neighbour in row if neighbour < layout.taxels]
        for row in neighbour_table(layout, offsets).tolist()
    ]


def dilate(mask: Mask, table: NDArray[np.intp]) -> Mask:
    """Return the taxels of a mask and their neighbours (morphological dilation).

    Parameters
    ----------
    mask : ndarray
        Mask of taxels, shape [rows * cols].
    table : ndarray
        Neighbours of each taxel, from `neighbour_table`.

    Returns
    -------
    ndarray
        Mask, shape [rows * cols].
    """
    grown = np.append(mask, np.False_)
    return np.asarray(grown[:-1] | grown[table].any(axis=1))


def compiled_layout(layout: Layout) -> scan_path.Layout:
    """Return a layout for the compiled path.

    Parameters
    ----------
    layout : Layout
        Layout of an array.
    """
    return scan_path.Layout(layout.rows, layout.cols, layout.pitch_x, layout.pitch_y, layout.taxel_area)
