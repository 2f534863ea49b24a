# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Linear assignment for the data association of contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence


def minimum_cost_assignment(costs: Sequence[Sequence[float]], unassigned_cost: float) -> dict[int, int]:
    """Return the assignment of rows to columns with the least total cost.

    Rows are added one at a time along the shortest augmenting path (Hungarian method with dual prices); the result is
    optimal for any size.

    Parameters
    ----------
    costs : sequence of sequence of float, shape [rows, columns]
        Cost of each row with each column, >= 0, in any unit.
    unassigned_cost : float
        Cost of a row without a column, in the same unit; a column without a row costs nothing.

    Returns
    -------
    dict of int to int
        Column of each assigned row.

    References
    ----------
    J. Munkres, J. SIAM 5, 32, 1957.

    Examples
    --------
    >>> minimum_cost_assignment([[1.5, 9.0], [0.5, 1.5]], 4.0)
    {0: 0, 1: 1}
    """
    rows, given = len(costs), len(costs[0]) if costs else 0
    table = [[*row, *([unassigned_cost] * rows)] for row in costs]  # dummy columns represent no assignment
    row_prices, prices, owner = [0.0] * rows, [0.0] * (given + rows), [-1] * (given + rows)
    for new in range(rows):
        left, reached = set(range(given + rows)), list[int]()
        least, before = [math.inf] * (given + rows), [-1] * (given + rows)
        row, column = new, -1
        while row >= 0:
            for other in left:
                reduced = table[row][other] - row_prices[row] - prices[other]
                if reduced < least[other]:
                    least[other], before[other] = reduced, column
            column = min(left, key=least.__getitem__)
            step = least[column]
            row_prices[new] += step
            for other in reached:
                row_prices[owner[other]] += step
                prices[other] -= step
            left.remove(column)
            for other in left:
                least[other] -= step
            reached.append(column)
            row = owner[column]
        while column >= 0:
            owner[column] = owner[before[column]] if before[column] >= 0 else new
            column = before[column]
    return {row: column for column, row in sorted(enumerate(owner[:given]), key=lambda pair: pair[1]) if row >= 0}
