# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Centre of pressure and principal axes of a sampled force distribution, extrapolated beyond the edge of the array.

Forces of cells are integrals, so their weighted mean is very near to the centre of pressure (0.01 mm for a fingertip)
as long as the whole contact lies on the array. At the edge it is biased: a 2 N fingertip centred on the outermost
column reads 0.57 mm too far inside. There the profile across the edge is extrapolated by the rule of a Gaussian,
``s[k+1] = s[k]^2/s[k-1]*exp(-(pitch/width)^2)``.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout
from reference.contacts.in_order import sum_in_order

TRUNCATED_SHARE: Final = 0.02
"""A profile is truncated where its value at the edge is at least this share of its maximum [1]."""

MOST_BEYOND: Final = 3
"""Greatest number of extrapolated rows or columns beyond an edge."""

ITERATIONS: Final = 3
"""Iterations in which two truncated profiles extrapolate each other."""

FLANK: Final = 0.7
"""Curvature of a profile at its centre over that of its flank [1]: fitted to Hertz's sphere; 1 would be a Gaussian."""


Vector: TypeAlias = "tuple[float, float]"


Moments: TypeAlias = "tuple[Vector, Vector, Vector]"
"""Centre of pressure, major principal axis with x >= 0, and minor axis, 90 degrees counter-clockwise from it [m].

Each axis is as long as one standard deviation of the distribution.
"""


class MomentFinder:
    """Moments of force distributions on one array.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    spread : float
        Spread of the elastomer skin [m], the least width of a contact.
    """

    def __init__(self, layout: Layout, spread: float) -> None:
        taxels = np.arange(layout.taxels)
        self._axes = (taxels % layout.cols, layout.cols), (taxels // layout.cols, layout.rows)
        x, y = layout.positions.T
        self._powers = np.stack([np.ones(layout.taxels), x, y, x * x, y * y, x * y], axis=1)
        self._first = float(x[0]), float(y[0])
        self._pitch = layout.pitch_x, layout.pitch_y
        self._square = tuple(pitch * pitch for pitch in self._pitch)
        self._size = layout.cols, layout.rows
        self._narrowest = tuple(spread * spread + square / 12 for square in self._square)

    def basis(self, taxels: NDArray[np.intp], profiles: bool) -> NDArray[np.float64]:
        """Return the factors of the taxels' forces in the sums that `from_sums` needs.

        Parameters
        ----------
        taxels : ndarray of intp, shape [taxels]
            Indices of the taxels.
        profiles : bool
            Whether to include the profiles of the forces along x and y.

        Returns
        -------
        ndarray of float64, shape [taxels, sums]
            Powers 1, x, y, x2, y2 and xy [1, m, m, m2, m2, m2], and indicators of columns and rows for the profiles.
        """
        columns = [self._powers[taxels]]
        if profiles:
            columns += [index[taxels, None] == np.arange(size) for index, size in self._axes]
        return np.asfortranarray(np.concatenate(columns, axis=1))

    def profiles(self, taxels: NDArray[np.intp], weight: NDArray[np.float64]) -> list[float]:
        """Return the profiles alone: for many taxels faster than by `basis`, without a matrix in memory.

        Parameters
        ----------
        taxels : ndarray of intp, shape [taxels]
            Indices of the taxels.
        weight : ndarray of float64, shape [taxels]
            Their forces [N].

        Returns
        -------
        list of float
            Sums of the forces in each column, then in each row [N].
        """
        return [force for index, size in self._axes for force in np.bincount(index[taxels], weight, size).tolist()]

    def from_sums(self, sums: list[float]) -> Moments:
        """Return the moments of forces.

        Parameters
        ----------
        sums : list of float
            Sums of the products of the forces [N] with `basis`; the first one, the total force, > 0. Profiles are
            required where a taxel lies in the outermost rows or columns.

        Returns
        -------
        Moments
            Centre of pressure, extrapolated beyond the edge; the principal axes are those of the forces on the array.
        """
        total, x, y, xx, yy, xy = sums[:6]
        x, y = x / total, y / total
        xx, yy, xy = xx / total - x * x, yy / total - y * y, xy / total - x * y
        xx, yy = xx if xx > 0.0 else 0.0, yy if yy > 0.0 else 0.0
        if len(sums) > 6:
            end = 6 + self._size[0]
            x, y = self._extrapolated_centre(sums[6:end], sums[end:], (x, y), (xx, yy))
        return (x, y), *principal_axes(xx, yy, xy)

    def _extrapolated_centre(
        self, along_x: list[float], along_y: list[float], mean: Vector, variance: Vector
    ) -> Vector:
        """Return the centre [m] of two profiles, each extrapolated beyond the edges that truncate it.

        A round contact has the same width along both axes: the width for the extrapolation of one profile is that of
        the other, extrapolated itself. Where both are truncated, it starts from the profile's own flank.
        """
        (x, y), (wide_x, wide_y) = mean, variance
        cut_x, cut_y = _is_truncated(along_x), _is_truncated(along_y)
        if cut_x and cut_y:
            curvature_x, curvature_y = self._flank_curvature(0, along_x), self._flank_curvature(1, along_y)
            for _ in range(ITERATIONS):
                x, wide_x = self._extrapolate(0, along_x, mean[0], variance[0], curvature_x)
                y, wide_y = self._extrapolate(1, along_y, mean[1], variance[1], curvature_y)
                curvature_x, curvature_y = self._curvature(0, wide_y), self._curvature(1, wide_x)
        elif cut_x:
            x, _ = self._extrapolate(0, along_x, x, wide_x, self._curvature(0, wide_y))
        elif cut_y:
            y, _ = self._extrapolate(1, along_y, y, wide_y, self._curvature(1, wide_x))
        return x, y

    def _extrapolate(self, axis: int, values: list[float], mean: float, variance: float, curvature: float) -> Vector:
        """Return mean [m] and variance [m2] of a profile, extrapolated beyond its truncated ends.

        `mean` and `variance` are those of its values alone, `curvature` is (pitch/width)^2 [1].
        """
        first, pitch, square = self._first[axis], self._pitch[axis], self._square[axis]
        last, least, fall = len(values) - 1, TRUNCATED_SHARE * max(values), math.exp(-curvature)
        mean, variance, total = (mean - first) / pitch, variance / square, float(sum_in_order(np.array(values)))
        moment, second = mean * total, (variance + mean * mean) * total
        for edge, inner, direction in ((0, 1, -1), (last, last - 1, 1)):
            value, before = values[edge], values[inner]
            if value < least:
                continue
            # Not above the last value: a contact centred beyond the edge cannot be distinguished from a stronger one.
            ratio = value / (before if before > least else least) * fall
            ratio = ratio if ratio < 1.0 else 1.0
            beyond = edge
            for _ in range(MOST_BEYOND):
                value *= ratio
                ratio *= fall
                beyond += direction
                total += value
                moment += beyond * value
                second += beyond * beyond * value
                if value < least:
                    break
        mean = moment / total
        # Not beyond the outermost cells.
        return first + pitch * min(max(mean, -0.5), last + 0.5), (second / total - mean * mean) * square

    def _curvature(self, axis: int, variance_across: float) -> float:
        """Return (pitch/width)^2 [1] along an axis for a variance across it [m2]."""
        return self._square[axis] / max(variance_across, self._narrowest[axis])

    def _flank_curvature(self, axis: int, values: list[float]) -> float:
        """Return (pitch/width)^2 [1] from the last three values of the profile on its truncated side.

        At least the one with which the profile would be symmetric about its last value.
        """
        most = self._square[axis] / self._narrowest[axis]
        if len(values) < 3:
            return most
        outer, inner, edge = values[-3:] if values[-1] >= values[0] else values[2::-1]
        least = 0.5 * TRUNCATED_SHARE * max(values)
        outer, inner, edge = max(outer, least), max(inner, least), max(edge, least)
        curvature, mirrored = FLANK * math.log(inner * inner / (outer * edge)), 2.0 * math.log(edge / inner)
        return min(max(curvature, mirrored, 0.0), most)


def principal_axes(xx: float, yy: float, xy: float) -> tuple[Vector, Vector]:
    """Return the principal axes of second moments.

    Parameters
    ----------
    xx, yy, xy : float
        Variances along x and y and covariance [m2].

    Returns
    -------
    major : tuple of float
        Vector (x, y) of one standard deviation [m] along the major axis, with x >= 0.
    minor : tuple of float
        The same along the minor axis, 90 degrees counter-clockwise from the major one.

    Examples
    --------
    >>> principal_axes(1.0, 4.0, 0.0)
    ((0.0, 2.0), (-1.0, 0.0))
    """
    half, mean = 0.5 * (xx - yy), 0.5 * (xx + yy)
    spread = math.hypot(half, xy)
    large, small = math.sqrt(mean + spread), math.sqrt(mean - spread) if mean > spread else 0.0
    # Cosine and sine of half the angle of (half, xy).
    longer = math.sqrt(0.5 + 0.5 * abs(half) / spread) if spread else 1.0
    shorter = 0.5 * xy / (spread * longer) if spread else 0.0
    cosine, sine = (longer, shorter) if half >= 0.0 else (abs(shorter), math.copysign(longer, xy))
    return (large * cosine, large * sine), (-small * sine, small * cosine)


def _is_truncated(values: list[float]) -> bool:
    """Return whether a profile does not vanish within the array at one end or both."""
    least = TRUNCATED_SHARE * max(values)
    return len(values) > 1 and (values[0] >= least or values[-1] >= least)
