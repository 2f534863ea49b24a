"""Which goes with which, so that the costs add up to the least."""

from __future__ import annotations

import math
from collections.abc import Sequence


def cheapest_pairs(costs: Sequence[Sequence[float]], alone: float) -> dict[int, int]:
    """Return the column of each row that has one; a row without costs `alone`, a column without nothing.

    `costs` of each row with each column, shape [rows, columns], >= 0 in any unit. Rows come in one by one, each along
    the cheapest way on which others take another column for it: the Hungarian method with prices (J. Munkres,
    J. SIAM 5, 32, 1957), exact for any number.

    Examples
    --------
    >>> cheapest_pairs([[1.5, 9.0], [0.5, 1.5]], 4.0)
    {0: 0, 1: 1}
    """
    rows, given = len(costs), len(costs[0]) if costs else 0
    table = [[*row, *([alone] * rows)] for row in costs]  # with columns that stand for none
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
