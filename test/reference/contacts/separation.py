# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Separation of contacts so close to each other that they form one connected region.

Two fingertips two pitches apart have a saddle between them only while each is above a taxel of its own; after a move by
half a pitch, four taxels in a row read the same. So a region is *split* where it has peaks with a deep enough saddle
between them, and it *stays split* as long as the peaks, tracked from scan to scan, stay apart: the force of each taxel
is divided among them by a mixture of Gaussians of the skin's width, and the centres are those of their parts
(expectation-maximisation). Regions that merge stay split, too, until they press hard enough for a saddle to be
observable; then only if there is one.

References
----------
A. P. Dempster et al., J. R. Stat. Soc. B 39, 1, 1977.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import ALL_NEIGHBOURS, EDGE_NEIGHBOURS, neighbour_lists, neighbour_table
from reference.contacts.corners import opposite_corners
from reference.contacts.footprint import Footprint
from reference.contacts.in_order import sum_in_order
from reference.neighbour_estimate import NeighbourInterpolation

SADDLE_RATIO: Final = 0.6
"""Greatest ratio of a saddle to the lower of its two peaks [1]: with the remaining gain errors, cylinders and pads have
no such saddle."""

SHALLOW_SADDLE_RATIO: Final = 0.8
"""The same for contacts that were separate regions before [1]: a pad, too, may begin to touch in two spots, but soon
has no saddle."""

SHALLOW_SADDLE_DEPTH: Final = 0.2
"""Least depth of such a saddle [contact threshold]; other saddles are at least one contact threshold deep."""

LEAST_DISTANCE: Final = 1.25
"""Peaks closer to each other than this merge [pitch]."""

ELONGATION: Final = 0.4
"""A region is examined when its variance along the major axis exceeds that of the skin by this much [pitch2]."""

HOLE: Final = 0.3
"""A taxel that reads less than this share of the force interpolated from its neighbours is faulty, not a saddle [1]."""

LARGEST: Final = 100
"""Greatest number of taxels of a region that is examined: a larger one is no group of fingertips, and costly [1]."""

INITIAL_ITERATIONS: Final = 8
"""Iterations from the peaks of a saddle to the centres of the contacts."""

ITERATIONS: Final = 2
"""Iterations from the centres of one scan to those of the next."""

Positions: TypeAlias = Sequence["tuple[float, float]"]
"""Positions (x, y) [m]."""
Centre: TypeAlias = "tuple[float, float, float]"
"""Force [N] of a contact, and its position (x, y) [m]."""


class Separator:
    """Separates the contacts of one region.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    spread : float
        Spread of the elastomer skin [m].
    threshold : float
        Contact threshold [N], the least depth of a saddle.
    """

    def __init__(self, layout: Layout, spread: float, threshold: float) -> None:
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
        self.resolvable_force = SHALLOW_SADDLE_DEPTH * threshold / (1.0 - SHALLOW_SADDLE_RATIO)
        """Force of a taxel above which a peak without an observable shallow saddle has none [N]."""
        self.least_major_axis = math.sqrt(max(self._width) + ELONGATION * self._pitch**2)
        """Length of the major axis from which a region may contain several contacts [m]."""

    def peaks(
        self,
        footprint: Footprint,
        force: NDArray[np.float64],
        interpolated: NDArray[np.bool_] | None,
        were_apart: bool = False,
    ) -> Positions:
        """Return the peaks of a region that saddles separate (watershed).

        Parameters
        ----------
        footprint : Footprint
            Region in contact.
        force : ndarray of float64, shape [rows * cols]
            Forces of all taxels [N].
        interpolated : ndarray of bool, shape [rows * cols], or None
            Taxels that are interpolated: these are no saddle, and their neighbours belong to one peak.
        were_apart : bool, optional
            Whether the region consists of several former regions: a shallow saddle is then sufficient.

        Returns
        -------
        sequence of tuple of float
            Positions (x, y) of the peaks [m]; empty for fewer than two.
        """
        ratio, depth = SADDLE_RATIO, self._threshold
        if were_apart:
            ratio, depth = SHALLOW_SADDLE_RATIO, SHALLOW_SADDLE_DEPTH * self._threshold
        taxels = footprint.region.taxels
        if len(taxels) > LARGEST or (interpolated is None and self._has_one_peak(taxels, force)):
            return []
        values = dict(zip(taxels.tolist(), force[taxels].tolist(), strict=True))
        if interpolated is not None:
            known = {taxel: value for taxel, value in values.items() if not interpolated[taxel]}
            for taxel in values.keys() - known.keys():
                values[taxel] = max((known[other] for other in self._neighbours[taxel] if other in known), default=0.0)
        basin: dict[int, int] = {}  # peak to which each taxel belongs
        height: dict[int, float] = {}
        for taxel in sorted(values, key=values.__getitem__, reverse=True):
            saddles: dict[int, float] = {}
            for other in self._neighbours[taxel]:
                if other in basin:
                    saddle = values[taxel]
                    if corners := self._corners.get((taxel, other)):
                        # Between diagonal neighbours the force is about the mean of the four taxels there, but higher
                        # under a cylinder.
                        beside = sum(max(float(force[corner]), 0.0) for corner in corners)
                        saddle = min(saddle, 0.25 * ratio / SADDLE_RATIO * (saddle + values[other] + beside))
                    saddles[basin[other]] = max(saddle, saddles.get(basin[other], 0.0))
            basin[taxel], height[taxel] = taxel, values[taxel]
            for peak in sorted(saddles, key=saddles.__getitem__, reverse=True):
                low, high = sorted((peak, basin[taxel]), key=height.__getitem__)
                if saddles[peak] > ratio * height[low] or height[low] - saddles[peak] < depth:
                    del height[low]
                    basin.update({member: high for member, of in basin.items() if of == low})
        if len(height) < 2 or self._has_hole(footprint.members, force):
            return []
        return [(float(x), float(y)) for x, y in self._positions[sorted(height)]]

    def _has_one_peak(self, taxels: NDArray[np.intp], force: NDArray[np.float64]) -> bool:
        """Return whether at most one taxel of a region reads more than its four direct neighbours."""
        self._padded[:-1] = force
        highest = self._padded.take(self._beside.take(taxels, axis=0)).max(axis=1)
        return int(np.count_nonzero(force[taxels] >= highest)) < 2

    def _has_hole(self, members: NDArray[np.intp], force: NDArray[np.float64]) -> bool:
        """Return whether one of the taxels lacks its force because it is faulty."""
        least = self._surroundings.lower_bound(force, self._none, members, 0.0)
        return bool(((least > 2.0 * self._threshold) & (force[members] < HOLE * least)).any())

    def responsibilities(
        self, positions: Positions, footprint: Footprint, weight: NDArray[np.float64], iterations: int
    ) -> NDArray[np.float64] | None:
        """Return the share of each contact in each member of a region, by expectation-maximisation.

        Parameters
        ----------
        positions : sequence of tuple of float
            Initial positions (x, y) of the contacts [m].
        footprint : Footprint
            Region in contact.
        weight : ndarray of float64, shape [members]
            Forces of the members [N], >= 0.
        iterations : int
            Number of iterations.

        Returns
        -------
        ndarray of float64, shape [contacts, members], or None
            Shares [1], which sum up to 1 over the contacts; None: the contacts cannot be separated.
        """
        plane = footprint.basis[:, :3]  # 1, x and y
        moments = plane * weight[:, None]
        nearest = self._log_density(plane, [(1.0, *position) for position in positions]).argmax(axis=0)
        parts = np.bincount(nearest, weight, len(positions)) + 1e-9
        centres = [(part, *position) for part, position in zip(parts.tolist(), positions, strict=True)]
        for _ in range(iterations):
            shares = self._shares(plane, centres)
            sums = sum_in_order(shares[:, :, None] * moments, axis=1).tolist()
            centres = [(mass, x / mass, y / mass) for mass, x, y in sums if mass >= self._threshold]
            if len(centres) < 2:
                return None
        self._merge_close(centres)
        return self._shares(plane, centres) if len(centres) > 1 else None

    def _merge_close(self, centres: list[Centre]) -> None:
        """Remove the weaker one of every two centres that are too close to each other."""
        while len(centres) > 1:
            one, other = min(combinations(centres, 2), key=lambda pair: math.dist(pair[0][1:], pair[1][1:]))
            if math.dist(one[1:], other[1:]) >= LEAST_DISTANCE * self._pitch:
                return
            centres.remove(min(one, other))

    def _log_density(self, plane: NDArray[np.float64], centres: list[Centre]) -> NDArray[np.float64]:
        """Return ln(force*exp(-distance^2/(2*width^2))) of each centre at each member, shape [contacts, members].

        Terms that are the same for all centres are omitted: the rest is linear in x and y.
        """
        wide_x, wide_y = self._width
        lines = [
            (math.log(force) - 0.5 * (x * x / wide_x + y * y / wide_y), x / wide_x, y / wide_y)
            for force, x, y in centres
        ]
        return np.array(
            [constant + slope_x * plane[:, 1] + slope_y * plane[:, 2] for constant, slope_x, slope_y in lines]
        )

    def _shares(self, plane: NDArray[np.float64], centres: list[Centre]) -> NDArray[np.float64]:
        share = self._log_density(plane, centres)
        share = share - np.maximum.reduce(share)
        share = np.vectorize(math.exp, otypes=[float])(share)
        share /= np.add.reduce(share)
        return share
