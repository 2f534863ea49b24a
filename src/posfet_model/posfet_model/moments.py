"""Centre and principal axes of a force distribution sampled by taxels, with what the array's edge cuts off put back.

Forces of cells are integrals, so their weighted mean is very near to the centre of pressure (0.01 mm for a fingertip)
as long as the whole contact lies on the array. At the edge it is not: a 2 N fingertip centred on the outermost column
is read 0.57 mm too far inside. There the profile across the edge is carried on beyond it by the rule that holds for a
Gaussian, ``s[k+1] = s[k]^2/s[k-1]*exp(-(pitch/width)^2)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

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


@dataclass(frozen=True, slots=True)
class Moments:
    """Moments of a distribution of force; lengths in [m]."""

    centre: tuple[float, float]
    """Centre of pressure (x, y)."""
    major: tuple[float, float]
    """Principal axis, as long as one standard deviation of the distribution; x >= 0."""
    minor: tuple[float, float]
    """Axis across the major one, turned left from it, as long as one standard deviation."""


class MomentFinder:
    """Moments of regions on one array."""

    def __init__(self, layout: Layout, spread: float) -> None:
        """Take the array and the spread of its cover [m], below which no contact is narrow."""
        taxels = np.arange(layout.taxels)
        self._row, self._col = taxels // layout.cols, taxels % layout.cols
        self._x, self._y = (np.ascontiguousarray(axis) for axis in layout.positions.T)
        self._first = float(self._x[0]), float(self._y[0])
        self._pitch = layout.pitch_x, layout.pitch_y
        self._size = layout.cols, layout.rows
        self._narrowest = tuple(spread * spread + pitch * pitch / 12 for pitch in self._pitch)

    def find(self, taxels: NDArray[np.intp], weight: NDArray[np.float64], at_edge: bool) -> Moments:
        """Return the moments of `weight` [N] on the `taxels`, both of shape [k], the sum of weights above 0.

        `at_edge` says that a taxel of the outermost rows or columns is among them. The axes are those of what lies on
        the array.
        """
        x, y = self._x[taxels], self._y[taxels]
        total = float(np.add.reduce(weight))
        share_x, share_y = weight * x, weight * y
        mean_x, mean_y = float(weight @ x) / total, float(weight @ y) / total
        xx = max(float(share_x @ x) / total - mean_x * mean_x, 0.0)
        yy = max(float(share_y @ y) / total - mean_y * mean_y, 0.0)
        xy = float(share_x @ y) / total - mean_x * mean_y
        centre = mean_x, mean_y
        if at_edge:
            across_x = np.bincount(self._col[taxels], weight, self._size[0]).tolist()
            across_y = np.bincount(self._row[taxels], weight, self._size[1]).tolist()
            centre = self._completed((across_x, across_y))
        return Moments(centre, *principal_axes(xx, yy, xy))

    def _completed(self, profiles: tuple[list[float], list[float]]) -> tuple[float, float]:
        """Return the centre [m] of the profiles along x and y, each carried on beyond the edges that cut it.

        A contact that is round is as wide one way as the other: the width that carries one profile on is that of the
        other, carried on itself. It starts from the profile's own flank where both are cut.
        """
        along_x, along_y = (_Profile(profile) for profile in profiles)
        cut_x, cut_y = along_x.is_cut, along_y.is_cut
        mean_x, variance_x = along_x.carried_on(math.inf)
        mean_y, variance_y = along_y.carried_on(math.inf)
        if cut_x or cut_y:
            bend_x = self._flank_bend(0, along_x.values) if cut_y else self._bend(0, variance_y)
            bend_y = self._flank_bend(1, along_y.values) if cut_x else self._bend(1, variance_x)
            for _ in range(COMPLETIONS if cut_x and cut_y else 1):
                mean_x, variance_x = along_x.carried_on(bend_x)
                mean_y, variance_y = along_y.carried_on(bend_y)
                bend_x, bend_y = self._bend(0, variance_y), self._bend(1, variance_x)
        return self._position(0, mean_x), self._position(1, mean_y)

    def _position(self, axis: int, mean: float) -> float:
        """Return the coordinate [m] of a mean counted in taxels, not beyond the outermost cells."""
        last = self._size[axis] - 1
        return self._first[axis] + self._pitch[axis] * min(max(mean, -0.5), last + 0.5)

    def _bend(self, axis: int, variance_across: float) -> float:
        """Return (pitch/width)^2 [1] along an axis for a variance across it, in squares of the other pitch."""
        pitch = self._pitch[axis]
        variance = variance_across * self._pitch[1 - axis] ** 2
        return pitch * pitch / max(variance, self._narrowest[axis])

    def _flank_bend(self, axis: int, profile: list[float]) -> float:
        """Return (pitch/width)^2 [1] from the last three values of the profile on the side where it is cut.

        At least the one with which the profile would be symmetric about its last value.
        """
        pitch = self._pitch[axis]
        most = pitch * pitch / self._narrowest[axis]
        if len(profile) < 3:
            return most
        least = 0.5 * CUT_SHARE * max(profile)
        ends = profile[-3:] if profile[-1] >= profile[0] else profile[2::-1]
        outer, inner, edge = (math.log(max(value, least)) for value in ends)
        return min(max(FLANK * (2.0 * inner - outer - edge), 2.0 * (edge - inner), 0.0), most)


def principal_axes(xx: float, yy: float, xy: float) -> tuple[tuple[float, float], tuple[float, float]]:
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


class _Profile:
    """A distribution along one axis, counted from its first taxel [pitch]."""

    def __init__(self, values: list[float]) -> None:
        self.values = values
        self._least = CUT_SHARE * max(values)
        total = first = second = 0.0
        for index, value in enumerate(values):
            total += value
            first += index * value
            second += index * index * value
        self._sums = total, first, second

    @property
    def is_cut(self) -> bool:
        """Whether it reaches its first or last taxel."""
        return max(self.values[0], self.values[-1]) >= self._least

    def carried_on(self, bend: float) -> tuple[float, float]:
        """Return mean and variance with what lies beyond the two ends.

        `bend` is (pitch/width)^2 [1] of what lies beyond, inf for nothing.
        """
        total, first, second = self._sums
        values, least = self.values, self._least
        if bend < math.inf and len(values) > 1:
            fall = math.exp(-bend)
            last = len(values) - 1
            for inner, edge, index, way in ((values[1], values[0], 0, -1), (values[last - 1], values[last], last, 1)):
                if edge < least:
                    continue
                for step, beyond in enumerate(_beyond(inner, edge, fall, least), 1):
                    place = index + way * step
                    total += beyond
                    first += place * beyond
                    second += place * place * beyond
        mean = first / total
        return mean, second / total - mean * mean


def _beyond(inner: float, edge: float, fall: float, least: float) -> list[float]:
    """Return the values that follow the last two of a profile, until they are below `least`."""
    values: list[float] = []
    while edge >= least and len(values) < MOST_BEYOND:
        # Not above the last one: a contact whose middle is beyond the edge cannot be told from a stronger one.
        inner, edge = edge, min(edge, edge * edge / max(inner, least) * fall)
        values.append(edge)
    return values
