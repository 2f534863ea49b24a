# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of one scan from counts to contacts, in NumPy; posfet_core, scan_path.hpp, says what it does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.neighbour_estimate import most_over_neighbours
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import InverseSignalChain, force_noise_rms
from reference.bursts import BurstDetector
from reference.contacts import detection, slip, tracker
from reference.crosstalk import CrosstalkCompensator
from reference.force_integration import ForceIntegration
from reference.hum_filter import HumFilter
from reference.neighbour_estimate import NeighbourInterpolation
from reference.scan_clock import ScanClock

MOST_IMPLAUSIBLE: Final = 10
"""Number of consecutive scans with most taxels saturated after which such a scan is accepted."""

BASELINE_UNKNOWN, UNCERTAIN, TIME_UNCERTAIN, SCAN_UNUSABLE, NO_TAXEL = 1, 2, 4, 8, 16


class ScanPath:
    """Forces and contacts of one sensor, scan by scan, of parts that are references themselves.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    share : float
        Share of crosstalk [1].
    offset : ndarray of float64, shape [taxels]
        Charge densities without a force [C/m2].
    hum : HumFilter
        Mains hum.
    integration : ForceIntegration
        Forces.
    history : int
        Number of scans whose counts are kept.
    informative : float
        Force from which a taxel is informative about that of its neighbour [N].
    """

    def __init__(
        self,
        sensor: Sensor,
        share: float,
        offset: Array,
        hum: HumFilter,
        integration: ForceIntegration,
        history: int,
        informative: float,
    ) -> None:
        taxels = sensor.layout.taxels
        self.clock, self.bursts = ScanClock(sensor), BurstDetector(sensor)
        self._inverse, self._crosstalk = InverseSignalChain(sensor), CrosstalkCompensator(sensor.layout, share)
        self._offset, self.hum, self.integration, self._informative = offset, hum, integration, informative
        self.finder, self.tracker = detection.ContactFinder(sensor), tracker.ContactTracker(sensor)
        self.channel = slip.DynamicChannel(sensor.layout, force_noise_rms(sensor))
        self._neighbours, self._most = NeighbourInterpolation(sensor.layout), most_over_neighbours(sensor)
        self.history: list[tuple[NDArray[np.uint16], bool]] = []
        self._history = history
        self.vibration_wanted = self.blank = False
        self.charge, self._variance, self.filled, self.filled_deviation = np.zeros((4, taxels))
        self.saturated, self.interpolated, self._unlisted = np.zeros((3, taxels), np.bool_)
        self._implausible, self.result = 0, (False, False, False, 0, 0)
        self.contacts: tuple[Any, ...] = ()
        self.motions: dict[int, Any] = {}

    def set_faulty(self, unlisted: Mask, interpolated: Mask) -> None:
        """Set the faulty taxels, and those among them that are interpolated."""
        self.filled[interpolated & ~self.interpolated] = 0.0
        self.filled_deviation[interpolated & ~self.interpolated] = 0.0
        self._unlisted, self.interpolated = unlisted, interpolated

    def set_variance(self, variance: Array) -> None:
        """Set the variance of each force that it does not share with others [N2]."""
        self._variance = variance

    def process(
        self, scan: Scan, start: Callable[[Array, bool], None], end_block: Callable[[], None] = lambda: None
    ) -> tuple[bool, bool, bool, int, int]:
        """Process a scan; return what the compiled path returns. `end_block` is called before it changes anything.

        Parameters
        ----------
        scan : Scan
            The scan.
        start : callable
            Starts with the charges of a scan that has no predecessor; whether that is after an interruption.
        end_block : callable, optional
            Closes a block that is due.
        """
        clock, integration = self.clock, self.integration
        _, _, valid, reasons, before = self.result
        fits = clock.fits(scan)
        if fits and not clock.is_new(scan):
            self.result = False, False, valid, reasons, before
            return self.result
        end_block()
        accepted = fits and clock.is_sound(scan) and self._plausible(scan) and not self._has_burst(scan)
        self.blank = not accepted
        if not accepted:
            clock.refuse(scan)
            self.contacts = tuple(each for each in self.contacts if each.state != tracker.ContactState.RELEASED)
            self.result = False, True, False, SCAN_UNUSABLE, before
            return self.result
        clock.admit(scan)
        charge = self._crosstalk.apply(self.charge - self._offset)
        if clock.interrupted:
            integration.started = integration.valid = False
            self.channel.pause()
            self.hum.clear()
            self.hum.start_window()
        if self.hum.sampling:
            self.hum.remove(charge, clock.step)
        if not integration.process(charge, scan.temperatures, clock.step):
            start(charge, clock.interrupted)
        saturated = int(self.saturated.sum())
        if saturated:
            integration.clip(self.saturated, clock.step)
        integration.compensate_common_mode(not self.tracker.idle)
        if len(self.history) < self._history:
            self.history.append((scan.counts.copy(), clock.close))
        self._follow(clock.step, saturated)
        valid = integration.valid and not clock.suspect and not integration.ignored.all()
        reasons = TIME_UNCERTAIN if clock.suspect else 0
        if not integration.valid:
            known = (integration.offset_known | integration.ignored).all()
            reasons |= UNCERTAIN if known else BASELINE_UNKNOWN
        counted = int((self.saturated & ~integration.ignored).sum())
        self.result = True, False, valid, 0 if valid else reasons or NO_TAXEL, counted
        return self.result

    def _plausible(self, scan: Scan) -> bool:
        """Find saturated taxels; refuse a scan in which most are saturated, unless it persists."""
        self._inverse.charge(scan.counts, self.charge)
        self._inverse.saturated(scan.counts, self.saturated)
        if 2 * self.saturated.sum() <= len(self.saturated):
            self._implausible = 0
            return True
        self._implausible += 1
        if self._implausible > MOST_IMPLAUSIBLE:
            return True
        self.clock.counts.implausible += 1
        return False

    def _has_burst(self, scan: Scan) -> bool:
        found = self.bursts.is_burst(self.charge, scan.sequence, self.integration.ignored)
        self.clock.counts.bursts += found
        return found

    def _follow(self, step: float, saturated: int) -> None:
        """Find and follow the contacts."""
        integration, interpolated = self.integration, self.interpolated
        force, variance = integration.force, self._variance
        if interpolated.any():
            force, deviation = self.filled, self.filled_deviation
            deviation[:] = 0.0
            force[:] = np.where(interpolated, 0.0, integration.force)
            if self.finder.any(force):
                unknown, wanted = interpolated | ~integration.offset_known, interpolated.nonzero()[0]
                force[wanted], deviation[wanted] = self._neighbours.interpolate(
                    force, unknown, wanted, self._informative, *self._most
                )
            variance = np.where(interpolated, deviation**2, variance)
        regions = self.finder.find(force)
        if regions or self.vibration_wanted:
            self.channel.advance(integration.change, step)
            if self.vibration_wanted:
                self.channel.update_power(step)
        else:
            self.channel.pause()
        if not (regions or not self.tracker.idle):
            self.contacts = ()
            return
        taxels = detection.ForceEstimate(
            force,
            variance,
            self.saturated if saturated else None,
            self.finder.bits(self._unlisted),
            interpolated if interpolated.any() else None,
            integration.correlated_error,
            force - integration.held,
            integration.rise_deviation,
        )
        found = self.finder.measure(regions, taxels, self.tracker.regions)
        self.contacts = self.tracker.update(found, step)
        self.motions = self.channel.update(self.contacts, integration.force, step)
