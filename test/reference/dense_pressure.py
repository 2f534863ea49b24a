# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Pressure of a sphere integrated on a dense grid, independent of the contact model of the package.

Hertz's pressure is sampled every 50 um, blurred with a sampled Gaussian row by row and column by column, and summed
over the cells of the taxels. No code is shared with the closed forms of the simulation.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

GRID = 0.05e-3
HALF = 9e-3
AXIS = (np.arange(round(2 * HALF / GRID)) + 0.5) * GRID - HALF


@lru_cache
def blur_matrix(spread: float) -> NDArray[np.float64]:
    """Return the convolution with a sampled Gaussian [m] along one axis of the grid as a matrix."""
    kernel_axis = np.arange(-round(5 * spread / GRID), round(5 * spread / GRID) + 1) * GRID
    kernel = np.exp(-0.5 * (kernel_axis / spread) ** 2)
    kernel /= kernel.sum()
    return np.array([np.convolve(np.eye(1, len(AXIS), k)[0], kernel, "same") for k in range(len(AXIS))])


def sphere_forces(
    x: float, y: float, force: float, radius: float, modulus: float, spread: float, pitch: float, side: int
) -> NDArray[np.float64]:
    """Return the force [N] on each of side * side cells, row by row, of a sphere at (x, y) [m]."""
    contact_radius = (3 * force * radius / (4 * modulus)) ** (1 / 3)
    squared = ((AXIS[None, :] - x) ** 2 + (AXIS[:, None] - y) ** 2) / contact_radius**2
    pressure = np.sqrt(np.maximum(0.0, 1.0 - squared))
    pressure *= force / pressure.sum()
    blur = blur_matrix(spread)
    blurred = blur @ pressure @ blur.T
    edges = (np.arange(side + 1) - side / 2) * pitch
    cell = np.array([(low < AXIS) & (high > AXIS) for low, high in pairwise(edges)], float)
    cells: NDArray[np.float64] = cell @ blurred @ cell.T
    return cells.reshape(-1)
