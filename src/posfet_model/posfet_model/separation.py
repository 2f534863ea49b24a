"""Contacts so near to each other that their regions are one: told apart, and kept apart while they move.

Two fingertips two pitches apart show a valley only while each is above a taxel of its own; half a pitch further on four
taxels in a row read the same. So a region is *split* where it has peaks with a valley between them that is deep enough,
and it *stays split* as long as the peaks followed from scan to scan stay apart: each taxel's force is shared among them
as a mixture of Gaussians of the cover's width has it, and the centres are those of the shares (expectation and
maximisation: A. P. Dempster et al., J. R. Stat. Soc. B 39, 1, 1977).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor import Layout
from posfet_model.surroundings import Surroundings

VALLEY: Final = 0.6
"""A valley is at most this share of the lower of its two peaks [1]: left of wrong gains, rods and pads have none."""

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

Places = Sequence[tuple[float, float]]


class Separator:
    """Tells the contacts of one region apart."""

    def __init__(self, layout: Layout, spread: float, threshold: float) -> None:
        """Take the array, the spread of its cover [m], and the threshold of contacts [N], a valley's least depth."""
        self._layout = layout
        self._positions = layout.positions
        self._pitch = max(layout.pitch_x, layout.pitch_y)
        self._threshold = threshold
        self._surroundings = Surroundings(layout)
        self._none = np.zeros(layout.taxels, np.bool_)
        self._around = _neighbours(layout)
        self._neighbours = [[other for other in row if other < layout.taxels] for row in self._around.tolist()]
        self._padded = np.full(layout.taxels + 1, -np.inf)
        pitches = np.array([layout.pitch_x, layout.pitch_y])
        self._width = spread * spread + pitches * pitches / 12.0
        self.long = math.sqrt(float(self._width.max()) + LONG * self._pitch**2)
        """Length of the major axis from which a region may hold several contacts [m]."""

    def peaks(
        self,
        taxels: NDArray[np.intp],
        around: NDArray[np.intp],
        force: NDArray[np.float64],
        estimated: NDArray[np.bool_] | None,
    ) -> list[tuple[float, float]]:
        """Return the places [m] of a region's peaks that valleys tell apart; empty when there are not several.

        `taxels` are those of the region, `around` those and the ring around them, `force` [N] that of all taxels. One
        that is `estimated` is no valley: what lies around it is taken for one hill.
        """
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
            near = {hill[other] for other in self._neighbours[taxel] if other in hill}
            highest = max(near, key=height.__getitem__, default=taxel)
            hill[taxel] = highest
            if not near:
                height[taxel] = values[taxel]
            for peak in near - {highest}:
                if values[taxel] > VALLEY * height[peak] or height[peak] - values[taxel] < self._threshold:
                    del height[peak]
                    hill.update({member: highest for member, of in hill.items() if of == peak})
        if len(height) < 2 or self._is_hole(around, force):
            return []
        return [(float(x), float(y)) for x, y in self._positions[sorted(height)]]

    def _has_one_peak(self, taxels: NDArray[np.intp], force: NDArray[np.float64]) -> bool:
        """Return whether no more than one taxel of a region reads more than all of its neighbours."""
        self._padded[:-1] = force
        highest = self._padded[self._around[taxels]].max(axis=1)
        return int(np.count_nonzero(force[taxels] >= highest)) < 2

    def _is_hole(self, around: NDArray[np.intp], force: NDArray[np.float64]) -> bool:
        """Return whether one of the taxels is missing its force rather than lying in a valley."""
        least = self._surroundings.least(force, self._none, around, 0.0)
        return bool(((least > 2.0 * self._threshold) & (force[around] < MISSING * least)).any())

    def shares(
        self, places: Places, members: NDArray[np.intp], weight: NDArray[np.float64], rounds: int = ROUNDS
    ) -> NDArray[np.float64] | None:
        """Return each contact's share of the `members` [1], shape [contacts, members], from places [m] near theirs.

        `weight` [N] >= 0 is the force of the members. None when the contacts cannot be kept apart.
        """
        positions = self._positions[members]
        centres = np.array(places)
        parts = self._nearby(positions, centres, weight)
        for _ in range(rounds):
            share = self._shares_at(positions, centres, parts)
            mass = share @ weight
            if float(mass.min()) < self._threshold:
                there = mass >= self._threshold
                share, mass = share[there], mass[there]
                if len(mass) < 2:
                    return None
            centres = (share * weight) @ positions / mass[:, None]
            parts = mass / float(mass.sum())
        centres, parts = self._apart(centres, parts)
        return self._shares_at(positions, centres, parts) if len(centres) > 1 else None

    def _apart(
        self, centres: NDArray[np.float64], parts: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the centres without the weaker one of every two that have come too near to each other."""
        while len(centres) > 1:
            between = centres[:, None, :] - centres[None, :, :]
            distance = np.hypot(between[..., 0], between[..., 1])
            np.fill_diagonal(distance, np.inf)
            if float(distance.min()) >= NEAREST * self._pitch:
                break
            one, other = divmod(int(distance.argmin()), len(centres))
            weaker = one if parts[one] < parts[other] else other
            centres, parts = np.delete(centres, weaker, axis=0), np.delete(parts, weaker)
        return centres, parts

    def _nearby(
        self, positions: NDArray[np.float64], centres: NDArray[np.float64], weight: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the part of the force that is nearest to each centre [1], none of them zero."""
        square = ((positions[None] - centres[:, None]) ** 2).sum(axis=2)
        parts = np.bincount(square.argmin(axis=0), weight, len(centres)) + 1e-9
        found: NDArray[np.float64] = parts / parts.sum()
        return found

    def _shares_at(
        self, positions: NDArray[np.float64], centres: NDArray[np.float64], parts: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        exponent = -0.5 * ((positions[None] - centres[:, None]) ** 2 / self._width).sum(axis=2)
        density = parts[:, None] * np.exp(exponent - exponent.max(axis=0))
        share: NDArray[np.float64] = density / density.sum(axis=0)
        return share


def _neighbours(layout: Layout) -> NDArray[np.intp]:
    """Return the eight neighbours of each taxel, shape [taxels, 8]; `taxels` stands for none."""
    padded = np.full((layout.rows + 2, layout.cols + 2), layout.taxels, np.intp)
    padded[1:-1, 1:-1] = np.arange(layout.taxels).reshape(layout.rows, layout.cols)
    ways = [(down, right) for down in range(3) for right in range(3) if (down, right) != (1, 1)]
    beside = [padded[down : down + layout.rows, right : right + layout.cols].reshape(-1) for down, right in ways]
    return np.stack(beside, axis=1)
