# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Quantities of contacts that depend on their taxels alone; cached, as contacts rest for many scans."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout
from reference.contacts.connected_components import BitMap
from reference.contacts.moments import MomentFinder

FEW: Final = 64
"""Greatest number of taxels of a region whose profiles are part of its basis."""


class Outline(NamedTuple):
    """Taxels that a contact lists."""

    bits: int
    """The taxels as bits of `connected_components.BitMap`."""
    taxels: NDArray[np.intp]
    """Their indices, ascending."""
    centre: tuple[float, float]
    """Their mean position (x, y) [m]."""
    area: float
    """Area of their cells [m2]."""


class Footprint(NamedTuple):
    """A region in contact with the ring of taxels around it, without taxels that belong to two rings."""

    region: Outline
    wide: int
    """Region and ring, as bits."""
    members: NDArray[np.intp]
    """Indices of region and ring, ascending: the taxels that count toward force and moments."""
    basis: NDArray[np.float64]
    """Factors of the members' forces in the sums of `MomentFinder.from_sums`, shape [members, sums]."""
    profiles_apart: bool
    """Whether the profiles, needed at the edge of the array, are not part of the basis."""


class Footprints:
    """Footprints and outlines on one array.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    bitmap : BitMap
        Bits of its taxels.
    moments : MomentFinder
        Moments on the array.
    """

    def __init__(self, layout: Layout, bitmap: BitMap, moments: MomentFinder) -> None:
        self._bitmap = bitmap
        self._moments = moments
        self._positions = layout.positions
        self._cell = layout.pitch_x * layout.pitch_y
        taxels = np.arange(layout.taxels)
        rows, cols = taxels // layout.cols, taxels % layout.cols
        outermost = (rows == 0) | (rows == layout.rows - 1) | (cols == 0) | (cols == layout.cols - 1)
        self._edge = bitmap.pack(outermost)

    def outline(self, bits: int) -> Outline:
        """Return the outline of taxels given as bits, not 0."""
        taxels = self._bitmap.taxels(bits)
        x, y = self._positions[taxels].mean(axis=0).tolist()
        return Outline(bits, taxels, (x, y), len(taxels) * self._cell)

    def regions(self, mask: bytes) -> list[Footprint]:
        """Return the footprints of the connected components of a mask, shape [rows * cols], given as its bytes."""
        bits = self._bitmap.pack(np.frombuffer(mask, np.bool_))
        regions = self._bitmap.components(bits)
        rings = [self._bitmap.dilate(region) for region in regions]
        once = twice = 0
        for ring in rings:
            twice |= once & ring
            once |= ring
        return [self._footprint(region, ring & ~twice | region) for region, ring in zip(regions, rings, strict=True)]

    def _footprint(self, region: int, wide: int) -> Footprint:
        members = self._bitmap.taxels(wide)
        at_edge, few = bool(wide & self._edge), len(members) <= FEW
        basis = self._moments.basis(members, profiles=at_edge and few)
        return Footprint(self.outline(region), wide, members, basis, at_edge and not few)

    def dilated(self, mask: bytes, distance: int) -> NDArray[np.bool_]:
        """Return a mask, given as its bytes, dilated by a number of taxels."""
        flags = np.frombuffer(mask, np.bool_)
        bits = self._bitmap.pack(flags)
        for _ in range(distance):
            bits = self._bitmap.dilate(bits)
        return self._bitmap.mask(bits, np.empty(len(flags), np.bool_))

    def parts(self, wide: int, listed: int, count: int, owners: bytes) -> list[int]:
        """Return the taxels that each contact of a region lists, as bits, 0 for none.

        Arguments: members of the region and its listed taxels, as bits; number of contacts; for each member the number
        of the contact that owns it, as bytes of np.intp.
        """
        members, owner = self._bitmap.taxels(wide), np.frombuffer(owners, np.intp)
        return [self._bitmap.bits(members[owner == number]) & listed for number in range(count)]
