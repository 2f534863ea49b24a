# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Fraction of a point force that a cell under the elastomer skin receives, along one axis, as a lookup table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

GAUSSIAN_REACH: Final = 6.5
"""Reach of the Gaussian in standard deviations [1]: 1 - Phi(6.5) = 4e-11 is set to 0, so that the cells receive the
whole force."""

_STEPS_PER_SPREAD: Final = 512  # linear interpolation then has an error of max|phi'|/8/512^2 = 1.2e-7


class Workspace:
    """Two preallocated arrays, as allocating them costs more than filling them. Not thread-safe."""

    def __init__(self) -> None:
        self._numbers = np.empty(0, np.intp)
        self._values = np.empty(0)

    def arrays(self, shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return both arrays in this shape; the next call overwrites them."""
        size = math.prod(shape)
        if size > self._values.size:
            self._numbers, self._values = np.empty(size, np.intp), np.empty(size)
        return self._numbers[:size].reshape(shape), self._values[:size].reshape(shape)


@dataclass(frozen=True, eq=False)
class CellTable:
    """Fraction of the force over the position of the point, in uniform steps.

    A cell is a whole number of steps wide, so that one interpolation serves a whole row of cells.
    """

    cell: int
    """Number of steps in a cell."""
    steps_per_metre: float
    """Number of steps per metre [1/m]."""
    start: int
    """Number of steps from the start of the table to the edge of the cell."""
    fraction: NDArray[np.float64]
    """Fraction of the force at each step [1]."""
    rise: NDArray[np.float64]
    """Difference to the next step [1]."""

    def collect(self, positions: NDArray[np.float64], cells: int, work: Workspace) -> NDArray[np.float64]:
        """Return the fractions of the force that neighbouring cells receive.

        Parameters
        ----------
        positions : numpy.ndarray
            Positions of the points [m] from the edge of the first cell.
        cells : int
            Number of cells.
        work : Workspace
            Memory for the computation.

        Returns
        -------
        numpy.ndarray
            Fractions [1], shape [cells, ...]: error up to 2.4e-7, exactly 0 beyond 6.5 standard deviations; the sum
            over all cells is 1.
        """
        position = positions * self.steps_per_metre
        position += self.start
        index = position.astype(np.intp)
        position -= index
        of_cells, below = work.arrays((cells, *index.shape))
        np.subtract(index, (np.arange(cells) * self.cell).reshape(-1, *(1,) * index.ndim), out=of_cells)
        self.fraction.take(of_cells, mode="clip", out=below)
        fractions: NDArray[np.float64] = self.rise.take(of_cells, mode="clip")
        fractions *= position
        fractions += below
        return fractions


@lru_cache(maxsize=64)
def cell_table(pitch: float, spread: float) -> CellTable:
    """Return the table of a cell under a Gaussian.

    Parameters
    ----------
    pitch : float
        Width of a cell [m].
    spread : float
        Standard deviation of the Gaussian [m].
    """
    cell = math.ceil(_STEPS_PER_SPREAD * pitch / spread)
    per_spread = cell * spread / pitch
    reach = math.floor(GAUSSIAN_REACH * per_spread)
    below = [0.5 * math.erfc(-step / (per_spread * math.sqrt(2))) for step in range(-reach, reach + 1)]
    below[0], below[-1] = 0.0, 1.0
    enters = np.concatenate([np.zeros(1), below, np.ones(cell + 1)])
    leaves = np.concatenate([np.zeros(cell + 1), below, np.ones(1)])
    fraction = enters - leaves
    return CellTable(cell, cell / pitch, reach + 1, fraction, np.append(np.diff(fraction), 0.0))
