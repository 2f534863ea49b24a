"""Contacts: regions of the force map above a threshold, with their centre of pressure, force and shape.

A taxel enters a contact at the upper threshold and stays until it falls below the lower one, both raised where the
force is not known well enough. Around a contact one more ring of taxels is counted into force and moments, without
being listed: the threshold would otherwise cut off the contact's flanks, more of them on one side than on the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.labelling import BitMap
from posfet_model.moments import MomentFinder
from posfet_model.sensor import Sensor
from posfet_model.separation import FIRST_ROUNDS, Separator

ENTER_DEVIATIONS: Final = 5.0
"""Standard deviations that a force has to be above zero to begin a contact [1]."""

STAY_DEVIATIONS: Final = 2.5
"""Standard deviations above zero below which a contact is no longer told from none [1]."""


@dataclass(frozen=True, slots=True)
class Region:
    """One connected region that is touched, in the frame of the array."""

    bits: int
    """The taxels in contact as bits of `labelling.BitMap`."""
    taxels: NDArray[np.intp]
    """Their indices, ascending."""
    centre_of_pressure: tuple[float, float]
    """(x, y) [m]."""
    geometric_centre: tuple[float, float]
    """(x, y) [m], mean position of the taxels in contact."""
    force: float
    """Normal force, positive when pushed [N]; NaN when a taxel's force is not known."""
    force_variance: float
    """Its variance [N2]; NaN with a saturated taxel, whose force is a lower bound."""
    area: float
    """Area of the taxels' cells in contact [m2]."""
    peak_pressure: float
    """Greatest force of a taxel over the area of a taxel [Pa]; NaN with a saturated taxel, or where it is estimated."""
    major_axis: tuple[float, float]
    minor_axis: tuple[float, float]
    """Principal axes of the force distribution, each as long as one standard deviation [m]."""


@dataclass(frozen=True, slots=True)
class _Patch:
    """The taxels of a region in contact."""

    taxels: NDArray[np.intp]
    """Those listed, ascending."""
    bits: int
    """All of them."""
    members: NDArray[np.intp]
    """Those and the ring around them, as far as it is no other contact's."""
    force: NDArray[np.float64]
    """Of the members [N]."""
    at_edge: bool
    """Whether a member lies in an outermost row or column."""


@dataclass(frozen=True, slots=True)
class _Field:
    """What is known of all taxels in one scan, as `ContactFinder.measure` has it."""

    force: NDArray[np.float64]
    variance: NDArray[np.float64]
    common_variance: float
    saturated: NDArray[np.bool_] | None


class ContactFinder:
    """Finds contacts scan by scan; remembers which taxels were in one, for the hysteresis."""

    def __init__(self, sensor: Sensor) -> None:
        layout = sensor.layout
        self._bitmap = BitMap(layout.rows, layout.cols)
        self._moments = MomentFinder(layout, sensor.device.contact_spread)
        self._separator = Separator(layout, sensor.device.contact_spread, sensor.contact.threshold)
        self._positions = layout.positions
        self._cell = layout.pitch_x * layout.pitch_y
        self._taxel_area = layout.taxel_area
        self._threshold = sensor.contact.threshold
        self._stay_threshold = sensor.contact.threshold - sensor.contact.deadband
        taxels = np.arange(layout.taxels)
        rows, cols = taxels // layout.cols, taxels % layout.cols
        outermost = (rows == 0) | (rows == layout.rows - 1) | (cols == 0) | (cols == layout.cols - 1)
        self._edge = self._bitmap.pack(outermost)
        self._enter = np.full(layout.taxels, self._threshold)
        self._stay = np.full(layout.taxels, self._stay_threshold)
        self._floor = np.zeros(layout.taxels)
        self._above = np.zeros(layout.taxels, np.bool_)
        self._touched = np.zeros(layout.taxels, np.bool_)
        self._any = False
        self._bits, self._regions = 0, list[int]()  # what was labelled last: the same taxels are the same regions
        self.patches: list[NDArray[np.intp]] = []
        """Taxels counted into each region that was measured last, the ring around it among them."""

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Mask of the taxels in contact in the last scan, shape [rows * cols]; overwritten by the next."""
        return self._touched

    def around(self, taxels: NDArray[np.bool_], reach: int, out: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return in `out` the mask of what lies within `reach` taxels of the masked ones."""
        if not taxels.any():
            out[:] = False
            return out
        bits = self._bitmap.pack(taxels)
        for _ in range(reach):
            bits = self._bitmap.grow(bits)
        return self._bitmap.mask(bits, out)

    def adapt(
        self, variance: NDArray[np.float64], common_variance: float, usable: NDArray[np.bool_] | None = None
    ) -> None:
        """Set the thresholds for a variance of the forces [N2], that of each taxel and the one that all share.

        Taxels that are not `usable` are left out of contacts; None: all are usable.
        """
        deviation = np.sqrt(variance + common_variance)
        np.maximum(self._threshold, ENTER_DEVIATIONS * deviation, out=self._enter)
        np.maximum(self._stay_threshold, STAY_DEVIATIONS * deviation, out=self._stay)
        np.multiply(deviation, STAY_DEVIATIONS, out=self._floor)
        if usable is not None:
            for limit in (self._enter, self._stay, self._floor):
                limit[~usable] = math.inf

    def find(self, force: NDArray[np.float64]) -> list[int]:
        """Return the regions in contact for forces [N], shape [rows * cols], as bits; empty when nothing touches."""
        np.greater_equal(force, self._enter, out=self._above)
        if self._any:
            np.logical_and(self._touched, force >= self._stay, out=self._touched)
            np.logical_or(self._touched, self._above, out=self._touched)
            self._any = bool(self._touched.any())
        elif self._above.any():
            self._touched[:] = self._above
            self._any = True
        if not self._any:
            return []
        bits = self._bitmap.pack(self._touched)
        if bits != self._bits:
            self._bits, self._regions = bits, self._bitmap.regions(bits)
        return self._regions

    def measure(
        self,
        regions: list[int],
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        common_variance: float,
        saturated: NDArray[np.bool_] | None,
        unlisted: NDArray[np.bool_] | None = None,
        guessed: NDArray[np.bool_] | None = None,
        before: Sequence[Region] = (),
    ) -> list[Region]:
        """Measure the regions that `find` returned.

        variance [N2], shape [rows * cols], is that of each taxel alone, common_variance [N2] the one that all taxels
        share. Masks, None for none: `saturated` of taxels whose force is a lower bound; `unlisted` of those that count
        into force and moments, but are in no contact; `guessed` of those among them whose force comes from their
        neighbours, and that are no region by themselves. `before` are the contacts of the scan before: a region that
        holds several of them, or a valley, becomes several.
        """
        rings = [self._bitmap.grow(region) for region in regions]
        field = _Field(force, variance, common_variance, saturated)
        found: list[Region] = []
        self.patches.clear()
        for index, region in enumerate(regions):
            others = 0
            for other, ring in enumerate(rings):
                if other != index:
                    others |= ring
            taxels = self._bitmap.taxels(region)
            wide = rings[index] & ~others | region
            members = self._bitmap.taxels(wide)
            listed = taxels if unlisted is None else taxels[~unlisted[taxels]]
            if not len(listed):
                if unlisted is None or (guessed is not None and guessed[taxels].all()):
                    continue
                # Felt by a noisy taxel: a touch is felt by its neighbours, too.
                listed = members[~unlisted[members] & (force[members] > self._floor[members])]
                if not len(listed):
                    continue
            self.patches.append(members)
            patch = _Patch(listed, region, members, force[members], bool(wide & self._edge))
            weight = np.where(patch.force > self._floor[members], patch.force, 0.0)
            inside = [contact.centre_of_pressure for contact in before if contact.bits & region]
            whole = None if len(inside) > 1 else self._measure(patch, weight, field)
            if whole is None:
                shares = self._separator.shares(inside, members, weight)
            elif math.hypot(*whole.major_axis) < self._separator.long:
                shares = None
            else:
                peaks = self._separator.peaks(taxels, members, force, guessed)
                shares = self._separator.shares(peaks, members, weight, FIRST_ROUNDS) if peaks else None
            if shares is None:
                found.append(whole or self._measure(patch, weight, field))
            else:
                found += self._parts(patch, weight, field, shares)
        return found

    def _parts(
        self,
        patch: _Patch,
        weight: NDArray[np.float64],
        field: _Field,
        shares: NDArray[np.float64],
    ) -> list[Region]:
        """Measure the contacts of one region by their shares; each taxel is listed with the one that has most of it."""
        owner = np.zeros(len(field.force), np.intp)
        owner[patch.members] = shares.argmax(axis=0)
        parts = []
        for number, share in enumerate(shares):
            own = patch.taxels[owner[patch.taxels] == number]
            if len(own):
                mine = np.zeros(len(field.force), np.bool_)
                mine[own] = True
                part = replace(patch, taxels=own, bits=self._bitmap.pack(mine))
                parts.append(self._measure(part, weight * share, field))
        return parts

    def _measure(self, patch: _Patch, weight: NDArray[np.float64], field: _Field) -> Region:
        """Measure a contact by what of the members' force is its own [N], shape [members]."""
        taxels, members = patch.taxels, patch.members
        peak, highest = float(np.maximum.reduce(field.force[taxels])), float(np.maximum.reduce(patch.force))
        moments = self._moments.find(members, weight, patch.at_edge)
        bounded = field.saturated is not None and bool(field.saturated[taxels].any())
        total = math.nan if math.isnan(highest) else float(np.add.reduce(weight))
        counted = int(np.count_nonzero(weight))
        independent = float(field.variance[members] @ (weight > 0.0))
        centre = np.add.reduce(self._positions[taxels]).tolist()
        return Region(
            bits=patch.bits,
            taxels=taxels,
            centre_of_pressure=moments.centre,
            geometric_centre=(centre[0] / len(taxels), centre[1] / len(taxels)),
            force=total,
            force_variance=math.nan
            if bounded or math.isnan(total)
            else independent + counted * counted * field.common_variance,
            area=len(taxels) * self._cell,
            peak_pressure=math.nan if bounded or highest > peak else peak / self._taxel_area,
            major_axis=moments.major,
            minor_axis=moments.minor,
        )
