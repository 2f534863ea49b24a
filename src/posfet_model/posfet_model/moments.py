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
        total = float(weight.sum())
        share_x, share_y = weight * x, weight * y
        mean_x, mean_y = float(share_x.sum()) / total, float(share_y.sum()) / total
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
        wholes = [_carried_on(profile, math.inf) for profile in profiles]
        cut = [len(_beyond(profile, 0.0)) + len(_beyond(profile[::-1], 0.0)) > 0 for profile in profiles]
        bends = [
            self._flank_bend(axis, profiles[axis]) if cut[1 - axis] else self._bend(axis, wholes[1 - axis].variance)
            for axis in (0, 1)
        ]
        centres = [0.0, 0.0]
        for _ in range(COMPLETIONS):
            carried = [_carried_on(profile, bend) for profile, bend in zip(profiles, bends, strict=True)]
            bends = [self._bend(axis, carried[1 - axis].variance) for axis in (0, 1)]
            centres = [self._first[axis] + self._pitch[axis] * carried[axis].mean for axis in (0, 1)]
        return centres[0], centres[1]

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


@dataclass(frozen=True, slots=True)
class _Profile:
    """Mean, counted from the first taxel, and variance of a profile, in units of the pitch."""

    mean: float
    variance: float


def _carried_on(profile: list[float], bend: float) -> _Profile:
    """Return the moments of a profile with what lies beyond its two ends."""
    before, after = _beyond(profile[::-1], bend), _beyond(profile, bend)
    values = [*before[::-1], *profile, *after]
    total = sum(values)
    mean = sum(index * value for index, value in enumerate(values, -len(before))) / total
    variance = sum((index - mean) ** 2 * value for index, value in enumerate(values, -len(before))) / total
    return _Profile(mean, variance)


def _beyond(profile: list[float], bend: float) -> list[float]:
    """Return the values by which a profile goes on after its last one; `bend` is (pitch/width)^2 [1], inf for none."""
    least = CUT_SHARE * max(profile)
    if len(profile) < 2 or profile[-1] < least or math.isinf(bend):
        return []
    inner, last, values = profile[-2], profile[-1], list[float]()
    while last >= least and len(values) < MOST_BEYOND:
        # Not above the last one: a contact whose middle is beyond the edge cannot be told from a stronger one.
        inner, last = last, min(last, last * last / max(inner, least) * math.exp(-bend))
        values.append(last)
    return values
