"""Contacts so near to each other that their regions are one: told apart, and kept apart while they move.

Two fingertips two pitches apart show a valley only while each is above a taxel of its own; half a pitch further on four
taxels in a row read the same. So a region is *split* where it has peaks with a valley between them that is deep enough,
and it *stays split* as long as the peaks followed from scan to scan stay apart: each taxel's force is shared among them
as a mixture of Gaussians of the cover's width has it, and the centres are those of the shares (expectation and
maximisation: A. P. Dempster et al., J. R. Stat. Soc. B 39, 1, 1977). Regions that grow together stay split, too, until
they press hard enough for a valley to show; then only if there is one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.footprint import Footprint
from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import ALL_NEIGHBOURS, EDGE_NEIGHBOURS, neighbour_lists, neighbour_table, opposite_corners
from posfet_model.sensor.neighbour_estimate import NeighbourInterpolation

VALLEY: Final = 0.6
"""A valley is at most this share of the lower of its two peaks [1]: left of wrong gains, rods and pads have none."""

SHALLOW: Final = 0.8
"""The same for contacts that were regions of their own before [1]: a pad, too, may begin to touch at two places, but
soon has no valley."""

DIP: Final = 0.2
"""Least depth of such a valley [threshold]; others are as deep as the threshold of contacts at least."""

NEAREST: Final = 1.25
"""Peaks that come nearer to each other than this become one [pitch]."""

LONG: Final = 0.4
"""A region whose variance along its major axis exceeds that of the cover by this much is looked at [pitch2]."""

MISSING: Final = 0.3
"""A taxel that reads less than this share of what its neighbours tell is no valley but does not work [1]."""

LARGEST: Final = 100
"""A region of more taxels than this is not looked at: no set of fingertips, and dear [1]."""

FIRST_ROUNDS: Final = 8
"""Rounds from the peaks of a valley to the centres of the contacts."""

ROUNDS: Final = 2
"""Rounds from the centres of one scan to those of the next."""

Places: TypeAlias = Sequence["tuple[float, float]"]
Centre: TypeAlias = "tuple[float, float, float]"
"""Force [N] of a contact, and its place (x, y) [m]."""


class Separator:
    """Tells the contacts of one region apart."""

    def __init__(self, layout: Layout, spread: float, threshold: float) -> None:
        """Take the array, the spread of its cover [m], and the threshold of contacts [N], a valley's least depth."""
        self._positions = layout.positions
        self._pitch = max(layout.pitch_x, layout.pitch_y)
        self._threshold = threshold
        self._surroundings = NeighbourInterpolation(layout)
        self._none = np.zeros(layout.taxels, np.bool_)
        self._beside = neighbour_table(layout, EDGE_NEIGHBOURS)
        self._neighbours = neighbour_lists(layout, ALL_NEIGHBOURS)
        self._corners = opposite_corners(layout)
        self._padded = np.full(layout.taxels + 1, -np.inf)
        self._width = [spread * spread + pitch * pitch / 12.0 for pitch in (layout.pitch_x, layout.pitch_y)]
        self.telling = DIP * threshold / (1.0 - SHALLOW)
        """Force of a taxel from which a peak that has no shallow valley beside it has none [N]."""
        self.long = math.sqrt(max(self._width) + LONG * self._pitch**2)
        """Length of the major axis from which a region may hold several contacts [m]."""

    def peaks(
        self,
        footprint: Footprint,
        force: NDArray[np.float64],
        estimated: NDArray[np.bool_] | None,
        were_apart: bool = False,
    ) -> Places:
        """Return the places [m] of a region's peaks that valleys tell apart; empty when there are not several.

        `force` [N] is that of all taxels. One that is `estimated` is no valley: what lies around it is taken for one
        hill. Where there `were_apart` several regions before, a shallow valley will do.
        """
        valley, depth = (SHALLOW, DIP * self._threshold) if were_apart else (VALLEY, self._threshold)
        taxels = footprint.region.taxels
        if len(taxels) > LARGEST or (estimated is None and self._has_one_peak(taxels, force)):
            return []
        values = dict(zip(taxels.tolist(), force[taxels].tolist(), strict=True))
        if estimated is not None:
            known = {taxel: value for taxel, value in values.items() if not estimated[taxel]}
            for taxel in values.keys() - known.keys():
                values[taxel] = max((known[other] for other in self._neighbours[taxel] if other in known), default=0.0)
        hill: dict[int, int] = {}  # of a taxel: the peak it belongs to
        height: dict[int, float] = {}
        for taxel in sorted(values, key=values.__getitem__, reverse=True):
            passes: dict[int, float] = {}
            for other in self._neighbours[taxel]:
                if other in hill:
                    way = values[taxel]
                    if corners := self._corners.get((taxel, other)):
                        # Between two that touch at a corner lies about the mean of the four there, but more of a rod.
                        beside = sum(max(float(force[corner]), 0.0) for corner in corners)
                        way = min(way, 0.25 * valley / VALLEY * (way + values[other] + beside))
                    passes[hill[other]] = max(way, passes.get(hill[other], 0.0))
            hill[taxel], height[taxel] = taxel, values[taxel]
            for peak in sorted(passes, key=passes.__getitem__, reverse=True):
                low, high = sorted((peak, hill[taxel]), key=height.__getitem__)
                if passes[peak] > valley * height[low] or height[low] - passes[peak] < depth:
                    del height[low]
                    hill.update({member: high for member, of in hill.items() if of == low})
        if len(height) < 2 or self._is_hole(footprint.members, force):
            return []
        return [(float(x), float(y)) for x, y in self._positions[sorted(height)]]

    def _has_one_peak(self, taxels: NDArray[np.intp], force: NDArray[np.float64]) -> bool:
        """Return whether no more than one taxel of a region reads more than the four beside it."""
        self._padded[:-1] = force
        highest = self._padded.take(self._beside.take(taxels, axis=0)).max(axis=1)
        return int(np.count_nonzero(force[taxels] >= highest)) < 2

    def _is_hole(self, around: NDArray[np.intp], force: NDArray[np.float64]) -> bool:
        """Return whether one of the taxels is missing its force rather than lying in a valley."""
        least = self._surroundings.lower_bound(force, self._none, around, 0.0)
        return bool(((least > 2.0 * self._threshold) & (force[around] < MISSING * least)).any())

    def shares(
        self, places: Places, footprint: Footprint, weight: NDArray[np.float64], rounds: int
    ) -> NDArray[np.float64] | None:
        """Return each contact's share of a region's members [1], shape [contacts, members], from places near theirs.

        `places` [m], `weight` [N] >= 0 the force of the members. None when the contacts cannot be kept apart.
        """
        plane = footprint.basis[:, :3]  # 1, x and y
        moments = plane * weight[:, None]
        nearest = self._closeness(plane, [(1.0, *place) for place in places]).argmax(axis=0)
        parts = np.bincount(nearest, weight, len(places)) + 1e-9
        centres = [(part, *place) for part, place in zip(parts.tolist(), places, strict=True)]
        for _ in range(rounds):
            sums = self._shares_at(plane, centres).dot(moments).tolist()
            centres = [(mass, x / mass, y / mass) for mass, x, y in sums if mass >= self._threshold]
            if len(centres) < 2:
                return None
        self._keep_apart(centres)
        return self._shares_at(plane, centres) if len(centres) > 1 else None

    def _keep_apart(self, centres: list[Centre]) -> None:
        """Take out the weaker one of every two centres that have come too near to each other."""
        while len(centres) > 1:
            one, other = min(combinations(centres, 2), key=lambda pair: math.dist(pair[0][1:], pair[1][1:]))
            if math.dist(one[1:], other[1:]) >= NEAREST * self._pitch:
                return
            centres.remove(min(one, other))

    def _closeness(self, plane: NDArray[np.float64], centres: list[Centre]) -> NDArray[np.float64]:
        """Return ln(force*exp(-distance^2/(2*width^2))) of each centre at each member, shape [contacts, members].

        But for what is the same for all centres: what is left is linear in x and y.
        """
        wide_x, wide_y = self._width
        lines = [
            (math.log(force) - 0.5 * (x * x / wide_x + y * y / wide_y), x / wide_x, y / wide_y)
            for force, x, y in centres
        ]
        found: NDArray[np.float64] = np.array(lines).dot(plane.T)
        return found

    def _shares_at(self, plane: NDArray[np.float64], centres: list[Centre]) -> NDArray[np.float64]:
        share = self._closeness(plane, centres)
        share -= np.maximum.reduce(share)
        np.exp(share, out=share)
        share /= np.add.reduce(share)
        return share
