# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Numerical contact on an elastic half-space, independent of the closed forms of the simulation.

Pressure on a grid of equal rectangles, whose displacement is Love's closed form (Phil. Trans. R. Soc. A 228, 1929;
K. L. Johnson, Contact Mechanics, 1985, eq. 3.25), summed by FFT without circular wrap; pressure and contact area from
the gap by the conjugate gradient method of Polonsky and Keer (Wear 231, 1999), which assumes no shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEPS = 400
CLOSE = 1e-8
"""Change of the pressures relative to their sum at which the iteration ends."""

Grid = NDArray[np.float64]


@dataclass(frozen=True)
class Contact:
    """Solution of a contact problem."""

    x: Grid
    """Centres of the rectangles [m], shape [1, cols]."""
    y: Grid
    """Centres of the rectangles [m], shape [rows, 1]."""
    force: Grid
    """Force on each rectangle [N], shape [rows, cols]."""
    indentation: float
    """Indentation depth [m]."""


def axis(half: float, count: int) -> Grid:
    """Return the centres of `count` equal parts of [-half, half]."""
    return ((np.arange(count) + 0.5) / count * 2 - 1) * half


def press(gap: Grid, x: Grid, y: Grid, force: float, modulus: float) -> Contact:
    """Return the contact of a rigid body under a force [N]; `gap` [m], shape [rows, cols], infinite outside."""
    rows, cols = gap.shape
    half_x, half_y = (x[0, 1] - x[0, 0]) / 2, (y[1, 0] - y[0, 0]) / 2
    near = _offsets(cols, half_x)[None], _offsets(rows, half_y)[:, None]
    influence = np.fft.rfft2(_displacement(*near, half_x, half_y) / (np.pi * modulus * 4 * half_x * half_y))

    def displacement(load: Grid) -> Grid:
        return np.fft.irfft2(np.fft.rfft2(load, (2 * rows, 2 * cols)) * influence)[:rows, :cols]

    under = np.isfinite(gap)
    gap = np.where(under, gap, 0.0)
    load = np.where(under, force / under.sum(), 0.0)
    direction, before, restart = np.zeros_like(load), 1.0, 0.0
    for _ in range(STEPS):
        distance = displacement(load) + gap
        touching = load > 0
        distance -= distance[touching].mean()
        square = float((distance[touching] ** 2).sum())
        direction = np.where(touching, distance + restart * square / before * direction, 0.0)
        before = square
        pull = displacement(direction)
        pull -= pull[touching].mean()
        length = float((distance * direction)[touching].sum() / (pull * direction)[touching].sum())
        moved = np.where(touching, np.maximum(load - length * direction, 0.0), 0.0)
        overlap = under & (moved == 0) & (distance < 0)
        moved[overlap] -= length * distance[overlap]
        restart = 0.0 if overlap.any() else 1.0
        moved *= force / moved.sum()
        change, load = float(np.abs(moved - load).sum()), moved
        if change < CLOSE * force:
            break
    return Contact(x, y, load, float((displacement(load) + gap)[load > 0].mean()))


def _offsets(count: int, half: float) -> Grid:
    """Return the distances of the rectangles [m] in FFT order."""
    return np.fft.fftfreq(2 * count, 1 / (2 * count)) * 2 * half


def _displacement(x: Grid, y: Grid, half_x: float, half_y: float) -> Grid:
    """Return Love's displacement times pi*E under a pressure of 1 on a rectangle centred at 0."""

    def part(along: Grid, across: Grid) -> Grid:
        return along * np.arcsinh(across / np.abs(along))

    def sides(along: Grid, half_along: float, across: Grid, half_across: float) -> Grid:
        low, high = along - half_along, along + half_along
        left, right = across - half_across, across + half_across
        return part(high, right) - part(high, left) - part(low, right) + part(low, left)

    return sides(x, half_x, y, half_y) + sides(y, half_y, x, half_x)
