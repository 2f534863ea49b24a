# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The corners of the 2 x 2 squares of an array."""

from __future__ import annotations

from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import neighbour_table


def opposite_corners(layout: Layout) -> dict[tuple[int, int], tuple[int, int]]:
    """Return for every ordered pair of diagonal neighbours the two taxels that complete their 2 x 2 square.

    Parameters
    ----------
    layout : Layout
        The array.

    Returns
    -------
    dict of tuple of int to tuple of int
        The two other taxels of the square, by the pair.

    Examples
    --------
    >>> opposite_corners(Layout(1, 2, 2, 1e-3, 1e-3, 1e-6))[0, 3]
    (1, 2)
    """
    table = neighbour_table(layout, ((0, 1), (1, 0), (1, 1)))
    complement: dict[tuple[int, int], tuple[int, int]] = {}
    for taxel, (right, below, diagonal) in enumerate(table.tolist()):
        if diagonal < layout.taxels:
            complement[taxel, diagonal] = complement[diagonal, taxel] = (right, below)
            complement[right, below] = complement[below, right] = (taxel, diagonal)
    return complement
