"""Contacts: regions of the force map above a threshold, with their centre of pressure, force and shape.

A taxel enters a contact at the upper threshold and stays until it falls below the lower one, both raised where the
force is not known well enough. Around a contact one more ring of taxels is counted into force and moments, without
being listed: the threshold would otherwise cut off the contact's flanks, more of them on one side than on the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.connected_components import BitMap
from posfet_model.contacts.footprint import Footprint, Footprints
from posfet_model.contacts.moments import MomentFinder
from posfet_model.contacts.separation import FIRST_ROUNDS, ROUNDS, Places, Separator
from posfet_model.sensor.description import Sensor

ENTER_DEVIATIONS: Final = 5.0
"""Standard deviations that a force has to be above zero to begin a contact [1]."""

STAY_DEVIATIONS: Final = 2.5
"""Standard deviations above zero below which a contact is no longer told from none [1]."""

HELD: Final = 0.5
"""Unless it keeps this share of what its force was lately [1]: a zero wanders slowly, a release takes all at once."""

LATELY: Final = 0.996
"""Share of that which is remembered from one `adapt` to the next [1]: 5 s of blocks of 20 ms."""

LEFT: Final = 0.02
"""Share of a force that the film's loops may leave behind when it has gone [1], assumed: no contact is told by less."""

STILL_FELT: Final = 0.5
"""What a neighbour of a noisy taxel has to feel of a contact there to go on, of that to begin one [1]."""

LEAVING: Final = 0.1
"""A force that falls by more than this from one `adapt` to the next is still being let go, though its contact has ended
by a raised threshold [threshold]; the error of an offset makes less of it."""


class Region(NamedTuple):
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
    told_apart: bool = False
    """A valley told it from others in the same connected region."""


@dataclass(frozen=True, eq=False)
class Taxels:
    """What is known of all taxels; arrays of shape [rows * cols], masks None for none.

    Forces may be written to from scan to scan. Whatever else changes makes it another object.
    """

    force: NDArray[np.float64]
    """[N]."""
    variance: NDArray[np.float64]
    """Variance of each force alone [N2]."""
    common_variance: float = 0.0
    """Variance that all taxels share [N2]."""
    saturated: NDArray[np.bool_] | None = None
    """Taxels whose force is a lower bound."""
    unlisted: int = 0
    """Taxels that count into force and moments, but are in no contact, as bits of `labelling.BitMap`."""
    guessed: NDArray[np.bool_] | None = None
    """Those among them whose force comes from their neighbours, and that are no region by themselves."""
    correlated_error: NDArray[np.float64] | None = None
    """What a standard deviation of an error that they have in common makes of each force [N]."""

    _sums: dict[tuple[int, bytes], float] = field(default_factory=dict, init=False, repr=False)

    def variance_of_sum(self, footprint: Footprint, counted: NDArray[np.bool_]) -> float:
        """Return the variance of the sum of the forces of those members of a region that are `counted` [N2]."""
        key = footprint.wide, counted.tobytes()
        known = self._sums.get(key)
        if known is None:
            known = self._sums[key] = self._variance_of_sum(footprint.members[counted])
        return known

    def _variance_of_sum(self, taxels: NDArray[np.intp]) -> float:
        variance = float(np.add.reduce(self.variance[taxels])) + len(taxels) ** 2 * self.common_variance
        if self.correlated_error is not None:
            variance += float(np.add.reduce(self.correlated_error[taxels])) ** 2
        return variance


class _Patch(NamedTuple):
    """A region in one scan."""

    footprint: Footprint
    weight: NDArray[np.float64]
    """What of each member's force counts [N], shape [members]."""
    variance: float
    """Of their sum [N2]."""
    highest: float
    """Greatest force of a member [N]; NaN when one is not known."""
    taxels: Taxels
    """All of them."""


class ContactFinder:
    """Finds contacts scan by scan; remembers which taxels were in one, for the hysteresis."""

    def __init__(self, sensor: Sensor) -> None:
        layout = sensor.layout
        self._bitmap = BitMap(layout.rows, layout.cols)
        self._moments = MomentFinder(layout, sensor.device.contact_spread)
        self._footprints = Footprints(layout, self._bitmap, self._moments)
        self._separator = Separator(layout, sensor.device.contact_spread, sensor.contact.threshold)
        self._taxel_area = layout.taxel_area
        self._threshold = sensor.contact.threshold
        self._stay_threshold = sensor.contact.threshold - sensor.contact.deadband
        self._enter = np.full(layout.taxels, self._threshold)
        self._stay = np.full(layout.taxels, self._stay_threshold)
        self._limit = self._enter.copy()
        self._floor = np.zeros(layout.taxels)
        self._lately = np.zeros(layout.taxels)
        self._before = np.zeros(layout.taxels)
        self._touched = np.zeros(layout.taxels, np.bool_)
        self._mask = self._touched.tobytes()
        self._regions: list[Footprint] = []
        self.touched = np.zeros(layout.taxels, np.bool_)
        """Mask of the taxels in contact in any scan since the last `adapt`, or just leaving one, [rows * cols]."""
        self.patches: list[NDArray[np.intp]] = []
        """Taxels counted into each region that was measured last, the ring around it among them."""

    def bits(self, taxels: NDArray[np.bool_]) -> int:
        """Return a mask, shape [rows * cols], as bits of `labelling.BitMap`."""
        return self._bitmap.pack(taxels)

    def around(self, taxels: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
        """Return the mask of what lies within `reach` taxels of the masked ones; not to be written to."""
        return self._footprints.around(taxels.tobytes(), reach)

    def adapt(
        self,
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        common_variance: float,
        usable: NDArray[np.bool_] | None = None,
    ) -> None:
        """Set the thresholds for forces [N] and their variance [N2], that of each taxel and the one that all share.

        Taxels that are not `usable` are left out of contacts; None: all are usable.
        """
        deviation = np.sqrt(variance + common_variance)
        np.fmax(force, LATELY * self._lately, out=self._lately)
        left = LEFT * self._lately
        np.maximum(np.maximum(self._threshold, left), ENTER_DEVIATIONS * deviation, out=self._enter)
        np.multiply(deviation, STAY_DEVIATIONS, out=self._floor)
        np.minimum(self._floor, HELD * self._lately, out=self._floor, where=self._touched)
        np.maximum(np.maximum(self._stay_threshold, left), self._floor, out=self._stay)
        if usable is not None:
            for limit in (self._enter, self._stay, self._floor):
                limit[~usable] = math.inf
        self._limit = np.where(self._touched, self._stay, self._enter)
        leaving = self.touched & (self._before - force > LEAVING * self._threshold)
        np.logical_or(self._touched, leaving, out=self.touched)
        self._before[:] = force

    def find(self, force: NDArray[np.float64]) -> list[Footprint]:
        """Return the regions in contact for forces [N], shape [rows * cols]; empty when nothing touches."""
        np.greater_equal(force, self._limit, out=self._touched)
        mask = self._touched.tobytes()
        if mask != self._mask:
            self._change(mask)
        return self._regions

    def _change(self, mask: bytes) -> None:
        """Take other taxels for those in contact."""
        touched = self._touched
        self._mask = mask
        self._regions = self._footprints.regions(mask)
        self._limit = np.where(touched, self._stay, self._enter)
        np.logical_or(self.touched, touched, out=self.touched)

    def measure(self, regions: Sequence[Footprint], taxels: Taxels, before: Sequence[Region] = ()) -> list[Region]:
        """Measure the regions that `find` returned.

        `before` are the contacts of the scan before: a region that holds several of them, told apart by a valley, or
        that shows one now, becomes several.
        """
        found: list[Region] = []
        self.patches.clear()
        np.fmax(self._lately, taxels.force, out=self._lately)
        for footprint in regions:
            listed = self._listed(footprint, taxels, before)
            if not listed:
                continue
            members, bits = footprint.members, footprint.region.bits
            self.patches.append(members)
            force = taxels.force[members]
            above = force > self._floor[members]
            highest = float(force[force.argmax()])
            # A product with 0 is faster, but leaves unknown what is not known.
            weight = np.where(above, force, 0.0) if math.isnan(highest) else force * above
            variance = taxels.variance_of_sum(footprint, above)
            patch = _Patch(footprint, weight, variance, highest, taxels)
            known = [contact for contact in before if contact.bits & bits]
            places: Places = [contact.centre_of_pressure for contact in known]
            whole, rounds, told = None, ROUNDS, True
            if len(known) < 2 or not all(contact.told_apart for contact in known):
                whole = self._measure(patch, weight, listed, bits)
                peaks = self._peaks(whole, patch, len(known) > 1)
                told = len(known) < 2 or len(peaks) >= len(known) or not self._too_weak_to_tell(known, patch)
                if told and len(peaks) != len(known):
                    places, rounds = peaks, FIRST_ROUNDS
            shares = self._separator.shares(places, footprint, weight, rounds) if len(places) > 1 else None
            if shares is not None:
                found += self._parts(patch, shares, listed, told)
            else:
                found.append(whole or self._measure(patch, weight, listed, bits))
        return found

    def _listed(self, footprint: Footprint, taxels: Taxels, before: Sequence[Region]) -> int:
        """Return which taxels a region lists, as bits; 0: it is no contact."""
        region = footprint.region
        listed = region.bits & ~taxels.unlisted
        if listed or (taxels.guessed is not None and taxels.guessed[region.taxels].all()):
            return listed
        # Felt by a noisy taxel: a touch is felt by its neighbours, too, to begin with more surely than later.
        share = STILL_FELT if any(contact.bits & region.bits for contact in before) else 1.0
        return footprint.wide & ~taxels.unlisted & self._bitmap.pack(taxels.force > share * self._floor)

    def _peaks(self, whole: Region, patch: _Patch, were_apart: bool) -> Places:
        """Return where the contacts of a region may be, by its valleys; empty when it is one."""
        if math.hypot(*whole.major_axis) < self._separator.long:
            return []
        return self._separator.peaks(patch.footprint, patch.taxels.force, patch.taxels.guessed, were_apart)

    def _too_weak_to_tell(self, known: Sequence[Region], patch: _Patch) -> bool:
        """Return whether there may be a valley between contacts that were apart before, though none is seen."""
        guessed, taxels = patch.taxels.guessed, patch.footprint.region.taxels
        weakest = min([contact.peak_pressure for contact in known]) * self._taxel_area
        return weakest < self._separator.telling or (guessed is not None and bool(guessed[taxels].any()))

    def _parts(self, patch: _Patch, shares: NDArray[np.float64], listed: int, told: bool) -> list[Region]:
        """Measure the contacts of one region by their shares; each taxel is listed with the one that has most of it."""
        owners = shares.argmax(axis=0)
        outlines = self._footprints.parts(patch.footprint.wide, listed, len(shares), owners.tobytes())
        force = patch.taxels.force[patch.footprint.members]
        found: list[Region] = []
        for index, bits in enumerate(outlines):
            if bits:
                own = patch._replace(highest=float(force[owners == index].max()))
                found.append(self._measure(own, shares[index] * patch.weight, bits, bits, told))
        return found

    def _measure(
        self, patch: _Patch, weight: NDArray[np.float64], listed: int, bits: int, told: bool = False
    ) -> Region:
        """Measure a contact by what of the members' force is its own [N], shape [members], and its taxels.

        These are given as bits: those that it lists, and all of them.
        """
        outline, taxels, highest = self._footprints.outline(listed), patch.taxels, patch.highest
        force = taxels.force[outline.taxels]
        peak = float(force[force.argmax()])
        footprint = patch.footprint
        sums = weight.dot(footprint.basis).tolist()
        if footprint.profiles_apart:
            sums += self._moments.profiles(footprint.members, weight)
        centre, major, minor = self._moments.of(sums)
        total = math.nan if math.isnan(highest) else sums[0]
        bounded = taxels.saturated is not None and bool(taxels.saturated[outline.taxels].any())
        return Region(
            bits,
            outline.taxels,
            centre,
            outline.centre,
            total,
            math.nan if bounded or math.isnan(total) else patch.variance,
            outline.area,
            math.nan if bounded or highest > peak else peak / self._taxel_area,
            major,
            minor,
            told,
        )
