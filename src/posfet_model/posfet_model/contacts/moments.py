"""Centre and principal axes of a force distribution sampled by taxels, with what the array's edge cuts off put back.

Forces of cells are integrals, so their weighted mean is very near to the centre of pressure (0.01 mm for a fingertip)
as long as the whole contact lies on the array. At the edge it is not: a 2 N fingertip centred on the outermost column
is read 0.57 mm too far inside. There the profile across the edge is carried on beyond it by the rule that holds for a
Gaussian, ``s[k+1] = s[k]^2/s[k-1]*exp(-(pitch/width)^2)``.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout

CUT_SHARE: Final = 0.02
"""A profile is cut off where its value at the edge is at least this share of its greatest [1]."""

MOST_BEYOND: Final = 3
"""Most rows or columns that are put back beyond an edge."""

COMPLETIONS: Final = 3
"""Rounds in which the two profiles complete each other."""

FLANK: Final = 0.7
"""Bend of a profile at its middle over that of its flank [1]: fitted to Hertz's sphere; 1 would be a Gaussian."""


Vector: TypeAlias = "tuple[float, float]"


Moments: TypeAlias = "tuple[Vector, Vector, Vector]"
"""Centre of pressure, and the principal axes: the major one, x >= 0, and across it, turned left, the minor one [m].

Each axis is as long as one standard deviation of the distribution.
"""


class MomentFinder:
    """Moments of regions on one array."""

    def __init__(self, layout: Layout, spread: float) -> None:
        """Take the array and the spread of its cover [m], below which no contact is narrow."""
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
        """Return what weights of the `taxels` are multiplied with for the sums of `of`, shape [taxels, sums].

        These are the powers 1, x, y, x2, y2 and xy, and if wanted the `profiles` of weights along x and y.
        """
        columns = [self._powers[taxels]]
        if profiles:
            columns += [place[taxels, None] == np.arange(size) for place, size in self._axes]
        return np.asfortranarray(np.concatenate(columns, axis=1))

    def profiles(self, taxels: NDArray[np.intp], weight: NDArray[np.float64]) -> list[float]:
        """Return the profiles alone: for many taxels faster than by `basis`, and without a matrix to keep."""
        return [force for place, size in self._axes for force in np.bincount(place[taxels], weight, size).tolist()]

    def of(self, sums: list[float]) -> Moments:
        """Return the moments of weights [N] from the sums of their products with `basis`, the first one above 0.

        Profiles are needed where a taxel of the outermost rows or columns is among them. The axes are those of what
        lies on the array.
        """
        total, x, y, xx, yy, xy = sums[:6]
        x, y = x / total, y / total
        xx, yy, xy = xx / total - x * x, yy / total - y * y, xy / total - x * y
        xx, yy = xx if xx > 0.0 else 0.0, yy if yy > 0.0 else 0.0
        if len(sums) > 6:
            end = 6 + self._size[0]
            x, y = self._completed(sums[6:end], sums[end:], (x, y), (xx, yy))
        return (x, y), *principal_axes(xx, yy, xy)

    def _completed(self, along_x: list[float], along_y: list[float], mean: Vector, variance: Vector) -> Vector:
        """Return the centre [m] of two profiles, each carried on beyond the edges that cut it.

        A contact that is round is as wide one way as the other: the width that carries one profile on is that of the
        other, carried on itself. It starts from the profile's own flank where both are cut.
        """
        (x, y), (wide_x, wide_y) = mean, variance
        cut_x, cut_y = _is_cut(along_x), _is_cut(along_y)
        if cut_x and cut_y:
            bend_x, bend_y = self._flank_bend(0, along_x), self._flank_bend(1, along_y)
            for _ in range(COMPLETIONS):
                x, wide_x = self._carried_on(0, along_x, mean[0], variance[0], bend_x)
                y, wide_y = self._carried_on(1, along_y, mean[1], variance[1], bend_y)
                bend_x, bend_y = self._bend(0, wide_y), self._bend(1, wide_x)
        elif cut_x:
            x, _ = self._carried_on(0, along_x, x, wide_x, self._bend(0, wide_y))
        elif cut_y:
            y, _ = self._carried_on(1, along_y, y, wide_y, self._bend(1, wide_x))
        return x, y

    def _carried_on(self, axis: int, values: list[float], mean: float, variance: float, bend: float) -> Vector:
        """Return mean [m] and variance [m2] of a profile with what lies beyond the ends that are cut.

        `mean` and `variance` are those of its values alone, bend is (pitch/width)^2 [1].
        """
        first, pitch, square = self._first[axis], self._pitch[axis], self._square[axis]
        last, least, fall = len(values) - 1, CUT_SHARE * max(values), math.exp(-bend)
        mean, variance, total = (mean - first) / pitch, variance / square, sum(values)
        moment, second = mean * total, (variance + mean * mean) * total
        for place, inner, way in ((0, 1, -1), (last, last - 1, 1)):
            value, before = values[place], values[inner]
            if value < least:
                continue
            # Not above the last one: a contact whose middle is beyond the edge cannot be told from a stronger one.
            ratio = value / (before if before > least else least) * fall
            ratio = ratio if ratio < 1.0 else 1.0
            beyond = place
            for _ in range(MOST_BEYOND):
                value *= ratio
                ratio *= fall
                beyond += way
                total += value
                moment += beyond * value
                second += beyond * beyond * value
                if value < least:
                    break
        mean = moment / total
        # Not beyond the outermost cells.
        return first + pitch * min(max(mean, -0.5), last + 0.5), (second / total - mean * mean) * square

    def _bend(self, axis: int, variance_across: float) -> float:
        """Return (pitch/width)^2 [1] along an axis for a variance across it [m2]."""
        return self._square[axis] / max(variance_across, self._narrowest[axis])

    def _flank_bend(self, axis: int, values: list[float]) -> float:
        """Return (pitch/width)^2 [1] from the last three values of the profile on the side where it is cut.

        At least the one with which the profile would be symmetric about its last value.
        """
        most = self._square[axis] / self._narrowest[axis]
        if len(values) < 3:
            return most
        outer, inner, edge = values[-3:] if values[-1] >= values[0] else values[2::-1]
        least = 0.5 * CUT_SHARE * max(values)
        outer, inner, edge = max(outer, least), max(inner, least), max(edge, least)
        bend, mirrored = FLANK * math.log(inner * inner / (outer * edge)), 2.0 * math.log(edge / inner)
        return min(max(bend, mirrored, 0.0), most)


def principal_axes(xx: float, yy: float, xy: float) -> tuple[Vector, Vector]:
    """Return the principal axes of second moments [m2], each as long as its standard deviation [m].

    Examples
    --------
    >>> principal_axes(1.0, 4.0, 0.0)
    ((0.0, 2.0), (-1.0, 0.0))
    """
    half, mean = 0.5 * (xx - yy), 0.5 * (xx + yy)
    spread = math.hypot(half, xy)
    large, small = math.sqrt(mean + spread), math.sqrt(mean - spread) if mean > spread else 0.0
    # Cosine and sine of half the angle at which (half, xy) lies.
    longer = math.sqrt(0.5 + 0.5 * abs(half) / spread) if spread else 1.0
    shorter = 0.5 * xy / (spread * longer) if spread else 0.0
    cosine, sine = (longer, shorter) if half >= 0.0 else (abs(shorter), math.copysign(longer, xy))
    return (large * cosine, large * sine), (-small * sine, small * cosine)


def _is_cut(values: list[float]) -> bool:
    """Return whether a profile does not fade within the array, at one end of it or at both."""
    least = CUT_SHARE * max(values)
    return len(values) > 1 and (values[0] >= least or values[-1] >= least)
