"""Contacts: regions of the force map above a threshold, with their centre of pressure, force and shape.

A taxel enters a contact at the upper threshold and stays until it falls below the lower one, both raised where the
force is not known well enough. Around a contact one more ring of taxels is counted into force and moments, without
being listed: the threshold would otherwise cut off the contact's flanks, more of them on one side than on the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.labelling import BitMap
from posfet_model.moments import MomentFinder
from posfet_model.sensor import Sensor

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


class ContactFinder:
    """Finds contacts scan by scan; remembers which taxels were in one, for the hysteresis."""

    def __init__(self, sensor: Sensor) -> None:
        layout = sensor.layout
        self._bitmap = BitMap(layout.rows, layout.cols)
        self._moments = MomentFinder(layout, sensor.device.contact_spread)
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
        return self._bitmap.regions(self._bitmap.pack(self._touched)) if self._any else []

    def measure(
        self,
        regions: list[int],
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        common_variance: float,
        saturated: NDArray[np.bool_] | None,
        estimated: NDArray[np.bool_] | None = None,
    ) -> list[Region]:
        """Measure the regions that `find` returned.

        variance [N2], shape [rows * cols], is that of each taxel alone, common_variance [N2] the one that all taxels
        share; `saturated` masks taxels whose force is a lower bound, None for none, `estimated` those whose force comes
        from their neighbours: they count into force and moments, but are in no contact. A region of such alone is none.
        """
        rings = [self._bitmap.grow(region) for region in regions]
        found = []
        self.patches.clear()
        for index, region in enumerate(regions):
            others = 0
            for other, ring in enumerate(rings):
                if other != index:
                    others |= ring
            wide = rings[index] & ~others | region
            taxels = self._bitmap.taxels(region)
            if estimated is not None:
                taxels = taxels[~estimated[taxels]]
            if len(taxels):
                found.append(self._measure(region, taxels, wide, force, variance, common_variance, saturated))
        return found

    def _measure(
        self,
        region: int,
        taxels: NDArray[np.intp],
        wide: int,
        force: NDArray[np.float64],
        variance: NDArray[np.float64],
        common_variance: float,
        saturated: NDArray[np.bool_] | None,
    ) -> Region:
        members = self._bitmap.taxels(wide)
        self.patches.append(members)
        members_force = force[members]
        peak = float(force[taxels].max())
        weight = np.where(members_force > self._floor[members], members_force, 0.0)
        moments = self._moments.find(members, weight, bool(wide & self._edge))
        bounded = saturated is not None and bool(saturated[taxels].any())
        total = math.nan if np.isnan(members_force).any() else float(weight.sum())
        counted = int(np.count_nonzero(weight))
        independent = float(variance[members] @ (weight > 0.0))
        centre = self._positions[taxels].sum(axis=0).tolist()
        return Region(
            bits=region,
            taxels=taxels,
            centre_of_pressure=moments.centre,
            geometric_centre=(centre[0] / len(taxels), centre[1] / len(taxels)),
            force=total,
            force_variance=math.nan
            if bounded or math.isnan(total)
            else independent + counted * counted * common_variance,
            area=len(taxels) * self._cell,
            peak_pressure=math.nan if bounded or float(members_force.max()) > peak else peak / self._taxel_area,
            major_axis=moments.major,
            minor_axis=moments.minor,
        )
