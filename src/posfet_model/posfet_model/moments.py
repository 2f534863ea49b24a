"""Centre and principal axes of a force distribution sampled by taxels, with what the array's edge cuts off put back.

Forces of cells are integrals, so their weighted mean is very near to the centre of pressure (0.01 mm for a fingertip)
as long as the whole contact lies on the array. At the edge it is not: a 2 N fingertip centred on the outermost column
is read 0.57 mm too far inside. There the profile across the edge is carried on beyond it by the rule that holds for a
Gaussian, ``s[k+1] = s[k]^2/s[k-1]*exp(-(pitch/width)^2)``.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor import Layout

CUT_SHARE: Final = 0.02
"""A profile is cut off where its value at the edge is at least this share of its greatest [1]."""

MOST_BEYOND: Final = 3
"""Most rows or columns that are put back beyond an edge."""

COMPLETIONS: Final = 3
"""Rounds in which the two profiles complete each other."""

FLANK: Final = 0.7
"""Bend of a profile at its middle over that of its flank [1]: fitted to Hertz's sphere; 1 would be a Gaussian."""


Vector: TypeAlias = "tuple[float, float]"


class Moments(NamedTuple):
    """Moments of a distribution of force; lengths in [m]."""

    centre: Vector
    """Centre of pressure (x, y)."""
    major: Vector
    """Principal axis, as long as one standard deviation of the distribution; x >= 0."""
    minor: Vector
    """Axis across the major one, turned left from it, as long as one standard deviation."""


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
        x, y = centre = x / total, y / total
        xx, yy = max(xx / total - x * x, 0.0), max(yy / total - y * y, 0.0)
        if len(sums) > 6:
            end = 6 + self._size[0]
            centre = self._completed(sums[6:end], sums[end:], total, centre, (xx, yy))
        return Moments(centre, *principal_axes(xx, yy, xy / total - x * y))

    def _completed(
        self, along_x: list[float], along_y: list[float], total: float, centre: Vector, variance: Vector
    ) -> Vector:
        """Return the centre [m] of two profiles, each carried on beyond the edges that cut it.

        A contact that is round is as wide one way as the other: the width that carries one profile on is that of the
        other, carried on itself. It starts from the profile's own flank where both are cut.
        """
        (x, y), (variance_x, variance_y) = centre, variance
        cut_x, cut_y = _is_cut(along_x), _is_cut(along_y)
        if cut_x and cut_y:
            one = self._profile(0, along_x, total, x, variance_x)
            other = self._profile(1, along_y, total, y, variance_y)
            bend_x, bend_y = self._flank_bend(0, one), self._flank_bend(1, other)
            for _ in range(COMPLETIONS - 1):
                (_, wide_x), (_, wide_y) = one.carried_on(bend_x), other.carried_on(bend_y)
                bend_x, bend_y = self._bend(0, wide_y * self._square[1]), self._bend(1, wide_x * self._square[0])
            return self._position(0, one, bend_x), self._position(1, other, bend_y)
        if cut_x:
            x = self._position(0, self._profile(0, along_x, total, x, variance_x), self._bend(0, variance_y))
        elif cut_y:
            y = self._position(1, self._profile(1, along_y, total, y, variance_y), self._bend(1, variance_x))
        return x, y

    def _profile(self, axis: int, values: list[float], total: float, mean: float, variance: float) -> _Profile:
        """Return a profile along an axis, of which mean [m] and variance [m2] are known."""
        return _Profile(values, total, (mean - self._first[axis]) / self._pitch[axis], variance / self._square[axis])

    def _position(self, axis: int, profile: _Profile, bend: float) -> float:
        """Return the mean [m] of a profile that is carried on, not beyond the outermost cells."""
        mean, _ = profile.carried_on(bend)
        last = self._size[axis] - 1
        return self._first[axis] + self._pitch[axis] * min(max(mean, -0.5), last + 0.5)

    def _bend(self, axis: int, variance_across: float) -> float:
        """Return (pitch/width)^2 [1] along an axis for a variance across it [m2]."""
        return self._square[axis] / max(variance_across, self._narrowest[axis])

    def _flank_bend(self, axis: int, profile: _Profile) -> float:
        """Return (pitch/width)^2 [1] from the last three values of the profile on the side where it is cut.

        At least the one with which the profile would be symmetric about its last value.
        """
        most, values = self._square[axis] / self._narrowest[axis], profile.values
        if len(values) < 3:
            return most
        outer, inner, edge = values[-3:] if values[-1] >= values[0] else values[2::-1]
        least = 0.5 * profile.least
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
    large, small = math.sqrt(mean + spread), math.sqrt(max(mean - spread, 0.0))
    angle = 0.5 * math.atan2(xy, half)
    cosine, sine = math.cos(angle), math.sin(angle)
    if abs(cosine) < 1e-15:
        cosine = 0.0
    return (large * cosine, large * sine), (-small * sine, small * cosine)


def _is_cut(values: list[float]) -> bool:
    """Return whether a profile does not fade within the array, at one end of it or at both."""
    least = CUT_SHARE * max(values)
    return len(values) > 1 and (values[0] >= least or values[-1] >= least)


class _Profile:
    """A distribution along one axis that is cut off, counted from its first taxel [pitch]."""

    __slots__ = ("_ends", "_sums", "least", "values")

    def __init__(self, values: list[float], total: float, mean: float, variance: float) -> None:
        self.values = values
        self.least = CUT_SHARE * max(values)
        """Value below which nothing is carried on."""
        self._ends: list[tuple[float, float, float, float]] = []
        """Of the ends that are cut: the last value, the one before it, its place, and the way on."""
        if values[0] >= self.least:
            self._ends.append((values[0], values[1], 0.0, -1.0))
        if values[-1] >= self.least:
            self._ends.append((values[-1], values[-2], len(values) - 1.0, 1.0))
        self._sums = total, mean * total, (variance + mean * mean) * total

    def carried_on(self, bend: float) -> tuple[float, float]:
        """Return mean and variance with what lies beyond the ends that are cut, whose bend is (pitch/width)^2 [1]."""
        total, first, second = self._sums
        fall, least = math.exp(-bend), self.least
        for edge, inner, end, way in self._ends:
            # Not above the last one: a contact whose middle is beyond the edge cannot be told from a stronger one.
            ratio = min(edge / max(inner, least) * fall, 1.0)
            value, place = edge, end
            for _ in range(MOST_BEYOND):
                value *= ratio
                ratio *= fall
                place += way
                total += value
                first += place * value
                second += place * place * value
                if value < least:
                    break
        mean = first / total
        return mean, second / total - mean * mean
