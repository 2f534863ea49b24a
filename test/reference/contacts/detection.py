# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contact detection: regions of the force map above a threshold, with centre of pressure, force and shape.

A taxel enters a contact at the enter threshold and stays in it until its force falls below the release threshold
(hysteresis); both rise with the uncertainty of the force. One more ring of taxels around a contact counts toward force
and moments, without being listed: the threshold would otherwise truncate the contact's flanks asymmetrically.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import ContactThresholds, Sensor
from reference.contacts.connected_components import BitMap
from reference.contacts.footprint import Footprint, Footprints
from reference.contacts.in_order import sum_in_order
from reference.contacts.moments import MomentFinder
from reference.contacts.separation import INITIAL_ITERATIONS, ITERATIONS, Positions, Separator

ENTER_DEVIATIONS: Final = 5.0
"""Standard deviations above zero from which a force begins a contact [1]."""

RELEASE_DEVIATIONS: Final = 2.5
"""Standard deviations above zero below which a force ends a contact [1]."""

HELD_SHARE: Final = 0.5
"""A contact does not end by that rule while it keeps this share of its recent force [1]: a baseline drifts slowly, a
release removes the whole force at once."""

RECENT_DECAY: Final = 0.996
"""Decay of the recent force [1] in"""

RECENT_TIME: Final = 0.02
"""this time [s], a block: 5 s."""

RESIDUAL_HYSTERESIS: Final = 0.02
"""Share of a force that the film's hysteresis may leave after its release [1], assumed: less force is no contact."""

NEIGHBOUR_RELEASE: Final = 0.5
"""Release threshold over enter threshold of the neighbours of a noisy taxel [1]."""

GREATER: Final = 1.0 + 1e-9
"""A force counts as greater than another where it is by this much [1]: interpolation from two equal forces gives theirs
to the rounding."""

RELEASING: Final = 0.1
"""Fall of a force between two threshold updates by which a contact that ended at a raised threshold is still being
released [contact threshold]; the error of an offset causes less."""


class Region(NamedTuple):
    """One connected region in contact, in the frame of the array."""

    bits: int
    """The taxels in contact as bits of `connected_components.BitMap`."""
    taxels: NDArray[np.intp]
    """Their indices, ascending."""
    centre_of_pressure: tuple[float, float]
    """(x, y) [m]."""
    geometric_centre: tuple[float, float]
    """(x, y) [m], mean position of the taxels in contact."""
    force: float
    """Normal force, positive when pushed [N]; NaN when a taxel's force is unknown."""
    force_variance: float
    """Variance of the force [N2]; NaN with a saturated taxel, whose force is a lower bound."""
    area: float
    """Area of the cells of the taxels in contact [m2]."""
    peak_pressure: float
    """Greatest force of a taxel over the area of a taxel [Pa]; NaN with a saturated taxel, or where that taxel is
    interpolated."""
    major_axis: tuple[float, float]
    """Major principal axis (x, y) of the force distribution, one standard deviation long [m]."""
    minor_axis: tuple[float, float]
    """Minor principal axis (x, y) of the force distribution, one standard deviation long [m]."""
    separated: bool = False
    """Whether a saddle separated it from others in the same connected region."""


@dataclass(frozen=True, eq=False)
class ForceEstimate:
    """Forces of all taxels with their uncertainty; arrays of shape [rows * cols], None for an empty mask.

    Forces may be overwritten from scan to scan. Any other change requires a new object.
    """

    force: NDArray[np.float64]
    """Force [N], positive when pushed."""
    variance: NDArray[np.float64]
    """Variance of each force that it does not share with others [N2]."""
    saturated: NDArray[np.bool_] | None = None
    """Taxels whose force is a lower bound."""
    unlisted: int = 0
    """Taxels that count toward force and moments, but are listed in no contact, as bits of
    `connected_components.BitMap`."""
    interpolated: NDArray[np.bool_] | None = None
    """Those among them whose force is interpolated from their neighbours, and that are no region by themselves."""
    correlated_error: NDArray[np.float64] | None = None
    """Factor E of the covariance E E' that the forces have in common [N], shape [rows * cols, causes]."""

    risen: NDArray[np.float64] | None = None
    """What the forces have changed by since the last block [N], shape [rows * cols]."""
    rise_deviation: float = 0.0
    """Relative standard deviation of that, shared by all [1]."""

    def variance_of_sum(self, footprint: Footprint, counted: NDArray[np.bool_]) -> float:
        """Return the variance of a sum of forces.

        Parameters
        ----------
        footprint : Footprint
            Region in contact.
        counted : ndarray of bool, shape [members]
            Members of the footprint whose forces are summed up.

        Returns
        -------
        float
            Variance of the sum [N2].
        """
        taxels = footprint.members[counted]
        variance = float(sum_in_order(self.variance[taxels]))
        # Errors of a reading that is not used count for nothing.
        measured = taxels if self.interpolated is None else taxels[~self.interpolated[taxels]]
        if self.correlated_error is not None:
            variance += float(np.square(self.correlated_error[measured].sum(axis=0)).sum())
        if self.risen is not None:
            variance += (self.rise_deviation * float(sum_in_order(self.risen[measured]))) ** 2
        return variance


class _Patch(NamedTuple):
    """A region in one scan."""

    footprint: Footprint
    weight: NDArray[np.float64]
    """Force of each member that counts [N], shape [members]."""
    variance: float
    """Variance of their sum [N2]."""
    highest: float
    """Greatest force of a member [N]; NaN when one is unknown."""
    taxels: ForceEstimate
    """Forces of all taxels."""


class ContactFinder:
    """Detects contacts scan by scan, with hysteresis.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        layout = sensor.layout
        self._bitmap = BitMap(layout.rows, layout.cols)
        self._moments = MomentFinder(layout, sensor.device.contact_spread)
        self._footprints = Footprints(layout, self._bitmap, self._moments)
        self._separator = Separator(layout, sensor.device.contact_spread, sensor.contact.threshold)
        self._taxel_area = layout.taxel_area
        self._threshold = sensor.contact.threshold
        self._release_threshold = sensor.contact.threshold - sensor.contact.deadband
        self._enter = np.full(layout.taxels, self._threshold)
        self._release = np.full(layout.taxels, self._release_threshold)
        self._limit = self._enter.copy()
        self._floor = np.zeros(layout.taxels)
        self._recent = np.zeros(layout.taxels)
        self._before = np.zeros(layout.taxels)
        self._touched = np.zeros(layout.taxels, np.bool_)
        self._mask = self._touched.tobytes()
        self._regions: list[Footprint] = []
        self.touched = np.zeros(layout.taxels, np.bool_)
        """Taxels in contact in any scan since the last threshold update, or being released, shape [rows * cols]."""
        self.patches: list[NDArray[np.intp]] = []
        """Members of each region in the last call of `measure`, the ring around it included."""

    def set_thresholds(self, contact: ContactThresholds) -> None:
        """Use other thresholds from the next `update_thresholds` on.

        Parameters
        ----------
        contact : ContactThresholds
            Thresholds of a taxel without uncertainty.
        """
        self._threshold, self._release_threshold = contact.threshold, contact.threshold - contact.deadband

    def bits(self, taxels: NDArray[np.bool_]) -> int:
        """Return a mask, shape [rows * cols], as bits of `connected_components.BitMap`."""
        return self._bitmap.pack(taxels)

    def dilated(self, taxels: NDArray[np.bool_], distance: int) -> NDArray[np.bool_]:
        """Return a mask, shape [rows * cols], dilated by `distance` taxels; read-only.

        Parameters
        ----------
        taxels : ndarray of bool, shape [rows * cols]
            Mask to dilate.
        distance : int
            Distance in taxels, along rows, columns and diagonals.
        """
        return self._footprints.dilated(taxels.tobytes(), distance)

    def update_thresholds(
        self,
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        usable: NDArray[np.bool_] | None = None,
        duration: float = RECENT_TIME,
    ) -> None:
        """Set the thresholds according to the uncertainty of the forces.

        Parameters
        ----------
        force : ndarray of float64, shape [rows * cols]
            Forces [N].
        variance : ndarray of float64, shape [rows * cols]
            Variance of each force that it does not share with others [N2].
        usable : ndarray of bool, shape [rows * cols], optional
            Taxels that may be in a contact; None: all.
        duration : float, optional
            Time since the last update [s].
        """
        deviation = np.sqrt(variance)
        np.fmax(force, RECENT_DECAY ** (duration / RECENT_TIME) * self._recent, out=self._recent)
        residual = RESIDUAL_HYSTERESIS * self._recent
        np.maximum(np.maximum(self._threshold, residual), ENTER_DEVIATIONS * deviation, out=self._enter)
        np.multiply(deviation, RELEASE_DEVIATIONS, out=self._floor)
        np.minimum(self._floor, HELD_SHARE * self._recent, out=self._floor, where=self._touched)
        np.maximum(np.maximum(self._release_threshold, residual), self._floor, out=self._release)
        if usable is not None:
            for limit in (self._enter, self._release, self._floor):
                limit[~usable] = math.inf
        self._limit = np.where(self._touched, self._release, self._enter)
        releasing = self.touched & (self._before - force > RELEASING * self._threshold)
        np.logical_or(self._touched, releasing, out=self.touched)
        self._before[:] = force

    def any(self, force: NDArray[np.float64]) -> bool:
        """Return whether any of these forces [N] would be in contact."""
        return bool((force >= self._limit).any())

    def find(self, force: NDArray[np.float64]) -> list[Footprint]:
        """Return the regions in contact.

        Parameters
        ----------
        force : ndarray of float64, shape [rows * cols]
            Forces [N].

        Returns
        -------
        list of Footprint
            Connected regions above the threshold; empty when nothing touches.
        """
        np.greater_equal(force, self._limit, out=self._touched)
        mask = self._touched.tobytes()
        if mask != self._mask:
            self._change(mask)
        return self._regions

    def _change(self, mask: bytes) -> None:
        """Change the set of taxels in contact."""
        touched = self._touched
        self._mask = mask
        self._regions = self._footprints.regions(mask)
        self._limit = np.where(touched, self._release, self._enter)
        np.logical_or(self.touched, touched, out=self.touched)

    def measure(
        self, regions: Sequence[Footprint], taxels: ForceEstimate, before: Sequence[Region] = ()
    ) -> list[Region]:
        """Measure the regions that `find` returned, and separate contacts that share one.

        Parameters
        ----------
        regions : sequence of Footprint
            Regions in contact.
        taxels : ForceEstimate
            Forces of all taxels.
        before : sequence of Region, optional
            Contacts of the previous scan. A region is split when it contains several of them that were separated, or
            when it has a saddle now.

        Returns
        -------
        list of Region
            Contacts.
        """
        found: list[Region] = []
        self.patches.clear()
        np.fmax(self._recent, taxels.force, out=self._recent)
        for footprint in regions:
            listed = self._listed(footprint, taxels, before)
            if not listed:
                continue
            members, bits = footprint.members, footprint.region.bits
            self.patches.append(members)
            force = taxels.force[members]
            above = force > self._floor[members]
            highest = float(force[force.argmax()])
            # A product with 0 is faster, but unknown forces must be excluded.
            weight = np.where(above, force, 0.0) if math.isnan(highest) else force * above
            variance = taxels.variance_of_sum(footprint, above)
            patch = _Patch(footprint, weight, variance, highest, taxels)
            known = [contact for contact in before if contact.bits & bits]
            positions: Positions = [contact.centre_of_pressure for contact in known]
            whole, iterations, separated = None, ITERATIONS, True
            if len(known) < 2 or not all(contact.separated for contact in known):
                whole = self._measure(patch, weight, listed, bits)
                peaks = self._peaks(whole, patch, len(known) > 1)
                separated = len(known) < 2 or len(peaks) >= len(known) or not self._is_unresolvable(known, patch)
                if separated and len(peaks) != len(known):
                    positions, iterations = peaks, INITIAL_ITERATIONS
            shares = None
            if len(positions) > 1:
                shares = self._separator.responsibilities(positions, footprint, weight, iterations)
            if shares is not None:
                found += self._parts(patch, shares, listed, separated)
            else:
                found.append(whole or self._measure(patch, weight, listed, bits))
        return found

    def _listed(self, footprint: Footprint, taxels: ForceEstimate, before: Sequence[Region]) -> int:
        """Return the taxels that a region lists, as bits; 0: it is no contact."""
        region = footprint.region
        listed = region.bits & ~taxels.unlisted
        if listed or (taxels.interpolated is not None and taxels.interpolated[region.taxels].all()):
            return listed
        # Only a noisy taxel is above the threshold: its neighbours must respond to the touch, too (with hysteresis).
        share = NEIGHBOUR_RELEASE if any(contact.bits & region.bits for contact in before) else 1.0
        return footprint.wide & ~taxels.unlisted & self._bitmap.pack(taxels.force > share * self._floor)

    def _peaks(self, whole: Region, patch: _Patch, were_apart: bool) -> Positions:
        """Return the positions of the peaks that saddles separate in a region; empty when it is one contact."""
        if math.hypot(*whole.major_axis) < self._separator.least_major_axis:
            return []
        return self._separator.peaks(patch.footprint, patch.taxels.force, patch.taxels.interpolated, were_apart)

    def _is_unresolvable(self, known: Sequence[Region], patch: _Patch) -> bool:
        """Return whether contacts that were separate regions may have a saddle, though none is observable."""
        interpolated, taxels = patch.taxels.interpolated, patch.footprint.region.taxels
        weakest = min(contact.peak_pressure for contact in known) * self._taxel_area
        return weakest < self._separator.resolvable_force or (
            interpolated is not None and bool(interpolated[taxels].any())
        )

    def _parts(self, patch: _Patch, shares: NDArray[np.float64], listed: int, separated: bool) -> list[Region]:
        """Measure the contacts of one region by their shares; each taxel is listed by the contact with most of it."""
        owners = shares.argmax(axis=0)
        outlines = self._footprints.parts(patch.footprint.wide, listed, len(shares), owners.tobytes())
        force = patch.taxels.force[patch.footprint.members]
        found: list[Region] = []
        for index, bits in enumerate(outlines):
            if bits:
                own = patch._replace(highest=float(force[owners == index].max()))
                found.append(self._measure(own, shares[index] * patch.weight, bits, bits, separated))
        return found

    def _measure(
        self, patch: _Patch, weight: NDArray[np.float64], listed: int, bits: int, separated: bool = False
    ) -> Region:
        """Measure a contact by its part of the members' forces [N], shape [members].

        `listed` are the taxels that it lists, `bits` all of its taxels, both as bits.
        """
        outline, taxels, highest = self._footprints.outline(listed), patch.taxels, patch.highest
        force = taxels.force[outline.taxels]
        peak = float(force[force.argmax()])
        footprint = patch.footprint
        sums = sum_in_order(weight[:, None] * footprint.basis).tolist()
        if footprint.profiles_apart:
            sums += self._moments.profiles(footprint.members, weight)
        centre, major, minor = self._moments.from_sums(sums)
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
            math.nan if bounded or highest > GREATER * peak else peak / self._taxel_area,
            major,
            minor,
            separated,
        )
