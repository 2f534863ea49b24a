"""What follows of contacts from their taxels alone. They stay where they are for many scans, so answers are kept."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.connected_components import BitMap
from posfet_model.contacts.moments import MomentFinder
from posfet_model.sensor.description import Layout

MOST_KNOWN: Final = 128
"""Answers of each kind that are kept."""

FEW: Final = 64
"""Most taxels of a region whose profiles are part of its basis."""


class Outline(NamedTuple):
    """The taxels that a contact lists."""

    bits: int
    """As bits of `labelling.BitMap`."""
    taxels: NDArray[np.intp]
    """Their indices, ascending."""
    centre: tuple[float, float]
    """Their mean position (x, y) [m]."""
    area: float
    """Area of their cells [m2]."""


class Footprint(NamedTuple):
    """A region in contact and the ring around it, as far as that is no other region's."""

    region: Outline
    wide: int
    """Region and ring, as bits."""
    members: NDArray[np.intp]
    """Indices of these, ascending: the taxels that count into force and moments."""
    basis: NDArray[np.float64]
    """What their forces are multiplied with for the sums of `MomentFinder.of`, shape [members, sums]."""
    profiles_apart: bool
    """Whether the profiles, needed at the edge of the array, are to be summed besides."""


class Footprints:
    """Footprints and outlines on one array; none of their arrays is to be written to."""

    def __init__(self, layout: Layout, bitmap: BitMap, moments: MomentFinder) -> None:
        self._bitmap = bitmap
        self._moments = moments
        self._positions = layout.positions
        self._cell = layout.pitch_x * layout.pitch_y
        taxels = np.arange(layout.taxels)
        rows, cols = taxels // layout.cols, taxels % layout.cols
        outermost = (rows == 0) | (rows == layout.rows - 1) | (cols == 0) | (cols == layout.cols - 1)
        self._edge = bitmap.pack(outermost)
        keep = lru_cache(MOST_KNOWN)
        self._footprint = keep(self._footprint_of)
        self.outline = keep(self._outline_of)
        """Return the outline of taxels that are given as bits, not 0."""
        self.regions = keep(self._regions_of)
        """Return the footprints of the regions of a mask, shape [rows * cols], given as its bytes."""
        self.around = keep(self._around_of)
        """Return the mask of what lies within so many taxels of the masked ones; the mask is given as its bytes."""
        self.parts = keep(self._parts_of)
        """Return what each contact of a region lists, as bits, 0 for nothing.

        Arguments: members of the region and what is listed of it, as bits, the number of contacts, and for each member
        the number of the contact that owns it, as bytes of np.intp.
        """

    def _outline_of(self, bits: int) -> Outline:
        taxels = self._bitmap.taxels(bits)
        x, y = self._positions[taxels].mean(axis=0).tolist()
        return Outline(bits, taxels, (x, y), len(taxels) * self._cell)

    def _regions_of(self, mask: bytes) -> list[Footprint]:
        bits = self._bitmap.pack(np.frombuffer(mask, np.bool_))
        regions = self._bitmap.regions(bits)
        rings = [self._bitmap.grow(region) for region in regions]
        once = twice = 0
        for ring in rings:
            twice |= once & ring
            once |= ring
        return [self._footprint(region, ring & ~twice | region) for region, ring in zip(regions, rings, strict=True)]

    def _footprint_of(self, region: int, wide: int) -> Footprint:
        members = self._bitmap.taxels(wide)
        at_edge, few = bool(wide & self._edge), len(members) <= FEW
        basis = self._moments.basis(members, profiles=at_edge and few)
        return Footprint(self.outline(region), wide, members, basis, at_edge and not few)

    def _around_of(self, mask: bytes, reach: int) -> NDArray[np.bool_]:
        flags = np.frombuffer(mask, np.bool_)
        bits = self._bitmap.pack(flags)
        for _ in range(reach):
            bits = self._bitmap.grow(bits)
        around = self._bitmap.mask(bits, np.empty(len(flags), np.bool_))
        around.flags.writeable = False
        return around

    def _parts_of(self, wide: int, listed: int, count: int, owners: bytes) -> list[int]:
        members, owner = self._bitmap.taxels(wide), np.frombuffer(owners, np.intp)
        return [self._bitmap.bits(members[owner == number]) & listed for number in range(count)]
