"""The share of a point's force that a cell under an elastic cover collects, along one axis, as a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

NORMAL_END: Final = 6.5
"""Reach of the Gaussian in standard deviations: 1 - Phi(6.5) = 4e-11 is set to 0, so that every force is shared out
without rest."""

_FINENESS: Final = 512  # steps in a standard deviation: linear interpolation is right to max|phi'|/8/512^2 = 1.2e-7


class Workspace:
    """Two arrays that are used again and again, as to be given new memory each time costs more than to fill it.

    For one thread at a time.
    """

    def __init__(self) -> None:
        self._numbers = np.empty(0, np.intp)
        self._values = np.empty(0)

    def arrays(self, shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return both in this shape; they hold until the next call."""
        size = math.prod(shape)
        if size > self._values.size:
            self._numbers, self._values = np.empty(size, np.intp), np.empty(size)
        return self._numbers[:size].reshape(shape), self._values[:size].reshape(shape)


@dataclass(frozen=True, eq=False)
class CellTable:
    """Shares over the place of the point, in even steps.

    The steps go a whole number of times into a cell, so that one place in the table serves a whole row of cells.
    """

    cell: int
    """Steps in a cell."""
    steps_per_metre: float
    start: int
    """Steps from the beginning of the table to the beginning of the cell."""
    share: NDArray[np.float64]
    """At each step."""
    rise: NDArray[np.float64]
    """To the next step."""

    def collect(self, places: NDArray[np.float64], cells: int, work: Workspace) -> NDArray[np.float64]:
        """Return the shares of `cells` neighbouring cells, shape [cells, ...]; places [m] from the first one's edge on.

        Right to 2.4e-7 of the force, exactly 0 beyond 6.5 standard deviations; all cells together collect all of it.
        """
        place = places * self.steps_per_metre
        place += self.start
        index = place.astype(np.intp)
        place -= index
        of_cells, below = work.arrays((cells, *index.shape))
        np.subtract(index, (np.arange(cells) * self.cell).reshape(-1, *(1,) * index.ndim), out=of_cells)
        self.share.take(of_cells, mode="clip", out=below)
        shares: NDArray[np.float64] = self.rise.take(of_cells, mode="clip")
        shares *= place
        shares += below
        return shares


@lru_cache(maxsize=64)
def cell_table(pitch: float, spread: float) -> CellTable:
    """Return the table for cells of this pitch [m] under a Gaussian of this standard deviation [m]."""
    cell = math.ceil(_FINENESS * pitch / spread)
    per_spread = cell * spread / pitch
    reach = math.floor(NORMAL_END * per_spread)
    below = [0.5 * math.erfc(-step / (per_spread * math.sqrt(2))) for step in range(-reach, reach + 1)]
    below[0], below[-1] = 0.0, 1.0
    enters = np.concatenate([np.zeros(1), below, np.ones(cell + 1)])
    leaves = np.concatenate([np.zeros(cell + 1), below, np.ones(1)])
    share = enters - leaves
    return CellTable(cell, cell / pitch, reach + 1, share, np.append(np.diff(share), 0.0))
