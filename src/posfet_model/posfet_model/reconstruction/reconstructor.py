# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Hot path of the model: a scan in, forces and contacts out. All memory is allocated once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import any_true
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.detection import ENTER_DEVIATIONS, ContactFinder, ForceEstimate
from posfet_model.contacts.slip import DynamicChannel, Motion
from posfet_model.contacts.tracker import Contact, ContactState, ContactTracker
from posfet_model.estimation.force_estimator import ForceEstimator
from posfet_model.reconstruction.bursts import BurstDetector
from posfet_model.reconstruction.force_image import ForceImage, non_negative
from posfet_model.reconstruction.mains_hum import MainsHum
from posfet_model.reconstruction.scan_clock import ScanClock, ScanCounts
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.reconstruction.taxel_faults import INFORMATIVE, TaxelFaultDetector, TaxelStatus
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.neighbour_estimate import INTERPOLATION_UNCERTAINTY
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import READING, InverseSignalChain, charge_per_newton, force_noise_rms

MOST_IMPLAUSIBLE: Final = 10
"""Number of consecutive scans with most taxels saturated after which such a scan is accepted."""


class InvalidReason(IntFlag):
    """Why a result is not fit for control; values of posfet_msgs/TactileWrench."""

    NONE = 0
    BASELINE_UNKNOWN = 1
    """The offset of a taxel is not known."""
    UNCERTAIN = 2
    """Forces recover from an interruption, or their uncertainty is above its limit."""
    TIME_UNCERTAIN = 4
    """The time since the scan before was derived for lack of a valid device time."""
    SCAN_UNUSABLE = 8
    """The scan was refused for its content."""
    NO_TAXEL = 16
    """None of these, but every taxel is faulty."""


@dataclass(slots=True)
class Reconstruction:
    """Result of the last scan.

    A reconstructor reuses the same object for every scan: `snapshot` returns a copy that stays.
    """

    accepted: bool
    """False: the scan was refused."""
    unusable: bool
    """The scan was refused for its content: stamp and sequence are its own, contacts those of the scan before, and
    `valid` is false. A duplicate or late scan is refused, too, and changes nothing else."""
    stamp: int
    """Acquisition time [ns] since the Unix epoch."""
    sequence: int
    """Sequence number of the scan."""
    valid: bool
    """False: not fit for control."""
    contacts: tuple[Contact, ...]
    """Contacts, ascending by id; released ones once."""
    motions: dict[int, Motion]
    """Vibration and slip of each contact that is not released, by its id."""
    saturated: int
    """Number of taxels at the end of their range."""
    reasons: InvalidReason = InvalidReason.NONE
    """Why it is not valid; NONE if it is."""

    def snapshot(self) -> Reconstruction:
        """Return an independent copy, which the next scan does not overwrite."""
        return replace(self, motions=dict(self.motions))


@dataclass(frozen=True, eq=False)
class Tare:
    """Result of a tare."""

    done: bool
    """False: refused."""
    message: str
    """What was changed, or why it was refused, in one line."""
    force_change: NDArray[np.float64]
    """Correction that was added to each force [N], shape [rows * cols]; empty when refused."""


class Reconstructor:
    """Forces and contacts of one sensor, scan by scan.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    calibration : Calibration, optional
        Properties of each taxel; None: nominal ones from the description.
    settings : ReconstructionSettings, optional
        Settings; None: the defaults.
    """

    def __init__(
        self,
        sensor: Sensor,
        calibration: Calibration | None = None,
        settings: ReconstructionSettings | None = None,
    ) -> None:
        taxels = sensor.layout.taxels
        settings = settings or ReconstructionSettings()
        self.calibration = calibration or Calibration.nominal(sensor)
        """Properties of each taxel in use."""
        self._clock = ScanClock(sensor)
        self._inverse = InverseSignalChain(sensor)
        self._crosstalk = CrosstalkCompensator(sensor.layout, self.calibration.crosstalk)
        self._estimator = ForceEstimator(sensor, settings.priors, self.calibration, settings.max_relative_uncertainty)
        noise = force_noise_rms(sensor)
        self._newton_per_charge = 1.0 / charge_per_newton(sensor)
        self._sensor, self._noise, self._settings = sensor, noise, settings
        self._hum = self._make_hum(settings)
        self._dynamic = DynamicChannel(sensor.layout, noise)
        self.vibration_wanted = False
        """Whether the dynamic channel runs while nothing touches, too, and averages the power of each taxel."""
        self._finder = ContactFinder(sensor)
        self._finder.set_thresholds(settings.contact or sensor.contact)
        self._tracker = ContactTracker(sensor)
        self._faults = TaxelFaultDetector(sensor, known_dead=self.calibration.dead)
        self._detects_faults = settings.fault_detection
        self._estimator.ignore(self._faults.faulty)
        self._bursts = BurstDetector(sensor)
        self._least = INFORMATIVE * noise
        pitch = min(sensor.layout.pitch_x, sensor.layout.pitch_y)
        self._contact_margin = math.ceil(3.0 * sensor.device.contact_spread / pitch) + 1
        self._readings = np.zeros(taxels, READING)
        self._charge, self._saturated = self._readings["charge"], self._readings["saturated"]
        volts_per_charge = sensor.volts_per_newton / charge_per_newton(sensor)
        self._offset_charge = self.calibration.offset / volts_per_charge
        self._any_offset = bool(self._offset_charge.any())
        self._filled = np.zeros(taxels)
        self._variance = np.zeros(taxels)
        self._estimate: ForceEstimate | None = None
        self._interpolated = np.zeros(taxels, np.bool_)
        self._informative = sensor.contact.threshold / ENTER_DEVIATIONS
        self._unlisted: NDArray[np.bool_] | None = None
        self._choose_interpolated()
        self._set_thresholds()
        self._saturated_now = 0
        self._implausible_in_a_row = 0
        self._blank = False  # whether the newest scan that was not refused as duplicate or late was unusable
        self._result = Reconstruction(False, False, 0, 0, False, (), {}, 0)
        self._image = ForceImage.unknown(taxels)

    @property
    def counts(self) -> ScanCounts:
        """Numbers of scans and events since the start, by cause."""
        return self._clock.counts

    @property
    def restarts(self) -> int:
        """Number of taxel restarts, each with an unknown offset, since the start."""
        return self._estimator.restarts

    @property
    def unsettled(self) -> int:
        """Number of taxels whose offset is unknown."""
        return int(np.count_nonzero(~self._estimator.offset_known))

    @property
    def faulty(self) -> int:
        """Number of dead, stuck and noisy taxels."""
        return int(np.count_nonzero(self._faults.faulty))

    @property
    def temperature_known(self) -> bool:
        """Whether a temperature sensor reports."""
        return self._estimator.film.known

    @property
    def rate(self) -> float:
        """Scans per second by the board clock [Hz]."""
        return self._clock.rate

    @property
    def hum_frequency(self) -> float:
        """Frequency of the mains hum that is subtracted [Hz]; NaN: no hum."""
        return self._hum.frequency

    @property
    def hum_amplitude(self) -> float:
        """Amplitude of the mains hum that is subtracted, root mean square of the taxels [N]."""
        return self._hum.amplitude * self._newton_per_charge

    @property
    def maintenance_due(self) -> bool:
        """Whether `run_maintenance` has work to do."""
        return self._estimator.block_due

    def process(self, scan: Scan) -> Reconstruction:
        """Process one scan.

        Parameters
        ----------
        scan : Scan
            The scan; not kept.

        Returns
        -------
        Reconstruction
            Result; overwritten by the next call.
        """
        result = self._result
        clock, estimator = self._clock, self._estimator
        fits = clock.fits(scan)
        if fits and not clock.is_new(scan):
            result.accepted = result.unusable = False
            return result
        if estimator.block_due:
            self._close_block()
        result.accepted = fits and clock.is_sound(scan) and self._plausible(scan) and not self._has_burst(scan)
        result.unusable = self._blank = not result.accepted
        if result.unusable:
            return self._flag(scan)
        clock.admit(scan)
        if self._any_offset:
            self._charge -= self._offset_charge
        charge = self._crosstalk.apply(self._charge) if self._crosstalk.present else self._charge
        if clock.interrupted:
            estimator.interrupt()
            self._dynamic.pause()
            self._hum.interrupt()
            self._estimate = None
        if self._hum.sampling:
            self._hum.remove(charge, clock.step)
        estimator.advance(charge, scan.temperatures, clock.step)
        result.saturated = self._saturated_now
        if result.saturated:
            estimator.inflate_variance(self._saturated, clock.step)
        estimator.compensate_common_mode(not self._tracker.idle)
        self._faults.add_scan(scan.counts, clock.close)
        regions = self._find_with_faulty() if self._any_interpolated else self._finder.find(estimator.force)
        if regions or self.vibration_wanted:
            self._dynamic.advance(estimator.change, clock.step)
            if self.vibration_wanted:
                self._dynamic.update_power(clock.step)
        else:
            self._dynamic.pause()
        if regions or not self._tracker.idle:
            result.contacts = self._follow(clock.step)
            result.motions = self._dynamic.update(self._tracker, estimator.force, clock.step)
        elif result.contacts:
            result.contacts = ()
        result.stamp = scan.stamp
        result.sequence = scan.sequence
        result.valid = estimator.valid and not clock.suspect
        result.reasons = InvalidReason.NONE if result.valid else self._reasons()
        return result

    def _reasons(self) -> InvalidReason:
        """Return why the result of an accepted scan is not valid."""
        reasons = InvalidReason.TIME_UNCERTAIN if self._clock.suspect else InvalidReason.NONE
        if not self._estimator.valid:
            settled = bool(self._estimator.offset_known.all())
            reasons |= InvalidReason.UNCERTAIN if settled else InvalidReason.BASELINE_UNKNOWN
        return reasons

    def run_maintenance(self) -> None:
        """Run the block maintenance now, after the results of a scan were published, instead of in the next `process`.

        Every 20 ms baselines are corrected and taxels tested, which takes several times as long as a scan.
        """
        if self._estimator.block_due:
            self._close_block()

    def change(self, settings: ReconstructionSettings) -> None:
        """Use other settings from the next scan on, without an interruption of forces and contacts.

        Mains hum that was found is estimated again after its removal is switched on.

        Parameters
        ----------
        settings : ReconstructionSettings
            New settings; those of the estimator itself must be as before.

        Raises
        ------
        ValueError
            If `priors` are others than before.
        """
        before, self._settings = self._settings, settings
        if settings.priors != before.priors:
            self._settings = before
            raise ValueError("priors must be as before: they are used when the estimator is made")
        if settings.hum_removal != before.hum_removal:
            self._hum = self._make_hum(settings)
        self._estimator.max_relative_uncertainty = settings.max_relative_uncertainty
        self._detects_faults = settings.fault_detection
        self._finder.set_thresholds(settings.contact or self._sensor.contact)
        self._set_thresholds()

    def _make_hum(self, settings: ReconstructionSettings) -> MainsHum:
        rate = self._sensor.can.scan_rate if settings.hum_removal else 0.0  # too low to find hum
        return MainsHum(self._sensor.layout.taxels, rate, self._noise / self._newton_per_charge)

    def tare(self, force: bool = False) -> Tare:
        """Set the forces to zero while nothing touches; refused under load, and while offsets are unknown.

        Parameters
        ----------
        force : bool, optional
            Set the forces to zero in any case, for an operator who knows that nothing touches, or wants changes from
            now on only. Contacts are released with the next scan. Offsets that are unknown stay unknown.

        Returns
        -------
        Tare
            Correction of each force, or why it was refused.
        """
        self.run_maintenance()
        result = self._result
        if force and self.counts.accepted:
            return self._tare(forced=True)
        live = [contact for contact in result.contacts if contact.state is not ContactState.RELEASED]
        none = np.zeros(0)
        if live:
            total = sum(contact.region.force for contact in live)
            load = f"contacts: {len(live)}, force: {total:.3f} N"
            return Tare(False, f"refused under load: {load}; release first, or force the tare", none)
        if not result.valid:
            return Tare(
                False, "refused: no valid forces yet; check that scans arrive, and leave the sensor untouched", none
            )
        return self._tare(forced=False)

    def _tare(self, forced: bool) -> Tare:
        """Set the forces to zero."""
        change = self._estimator.tare(forced)
        self._set_thresholds()
        self._estimate = None
        largest = int(np.abs(change).argmax())
        moved = float(change[largest])
        return Tare(True, f"baseline shifted by {moved * 1e3:+.3f} mN at most (taxel {largest})", change)

    def image(self) -> ForceImage:
        """Return the force image of the last scan that was neither duplicate nor late.

        Returns
        -------
        ForceImage
            Forces of all taxels with their uncertainty and status; overwritten by the next call.
        """
        image, estimator, faults = self._image, self._estimator, self._faults
        known = estimator.offset_known & ~faults.faulty if faults.any_faulty else estimator.offset_known
        self._variance = estimator.variance(self._variance)
        np.copyto(image.force, estimator.force, casting="same_kind")
        if self._result.contacts:
            self._keep_non_negative(known)
        self._variance = estimator.force_variance(self._variance)
        shared = estimator.correlated_error
        each = self._variance + np.einsum("ij,ij->i", shared, shared)
        np.sqrt(each, out=image.standard_deviation, casting="same_kind")
        image.status[:] = faults.status
        if self._blank:
            known = np.zeros_like(known)
        if faults.any_faulty or not estimator.valid or self._blank:
            image.force[~known] = math.nan
            image.standard_deviation[~known] = math.nan
        self._set_total(known)
        if self._result.saturated:
            bounded = self._saturated & ~faults.faulty
            if any_true(bounded):
                image.status[bounded] = TaxelStatus.SATURATED
                image.standard_deviation[bounded] = math.nan
                image.total_standard_deviation = math.nan
        return image

    def _set_total(self, known: NDArray[np.bool_]) -> None:
        """Set the loads and their sum: those of faulty taxels are estimated in contacts, as the contacts do it."""
        image, estimator = self._image, self._estimator
        image.total, image.total_standard_deviation = math.nan, math.nan
        image.load.fill(0.0)
        image.load_variance.fill(0.0)
        np.copyto(image.load, image.force, where=known)
        np.copyto(image.load_variance, self._variance, where=known)
        if not any_true(known):
            return
        image.total = float(estimator.force.sum(where=known))
        shared = estimator.correlated_error[known].sum(axis=0)
        variance = float(image.load_variance.sum()) + float(np.square(shared).sum())
        if self._result.contacts and self._faults.any_faulty:
            faulty = self._faults.faulty.nonzero()[0]
            estimated = self._interpolated[faulty]
            load = np.where(estimated, self._filled[faulty], estimator.force[faulty])
            image.load[faulty] = np.nan_to_num(load)
            image.load_variance[faulty] = np.where(estimated, _interpolation_variance(load), self._variance[faulty])
            image.total += float(image.load[faulty].sum())
            variance += float(image.load_variance[faulty].sum())  # NaN: a taxel without a usable neighbour
        image.total_standard_deviation = math.sqrt(variance)

    def covariance(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the covariance of weighted sums of the forces of the last `image`, such as a wrench.

        Parameters
        ----------
        weights : ndarray of float64, shape [sums, rows * cols]
            Weights of the loads in each sum.

        Returns
        -------
        ndarray of float64, shape [sums, sums]
            Covariance [N2] times the units of the weights; NaN while a taxel is saturated or none has a force.
        """
        estimator, image = self._estimator, self._image
        if math.isnan(image.total_standard_deviation):
            return np.full((len(weights), len(weights)), math.nan)
        known = np.where(np.isnan(image.force), 0.0, weights)
        shared = known @ estimator.correlated_error
        covariance: NDArray[np.float64] = (weights * image.load_variance) @ weights.T + shared @ shared.T
        return covariance

    def vibration(self) -> NDArray[np.float32]:
        """Return the RMS of each taxel's force above the corner frequency of the dynamic channel.

        Updated only while `vibration_wanted`.

        Returns
        -------
        ndarray of float32, shape [rows * cols]
            Vibration [N]; NaN for faulty and saturated taxels.
        """
        vibration = np.sqrt(self._dynamic.power).astype(np.float32)
        vibration[self._faults.faulty | self._saturated | self._blank] = math.nan
        return vibration

    def _flag(self, scan: Scan) -> Reconstruction:
        """Return the result of an unusable scan: the contacts stay as they were, and nothing is valid."""
        result = self._result
        result.stamp, result.sequence, result.valid = scan.stamp, scan.sequence, False
        result.reasons = InvalidReason.SCAN_UNUSABLE
        result.contacts = tuple(contact for contact in result.contacts if contact.state is not ContactState.RELEASED)
        return result

    def _keep_non_negative(self, known: NDArray[np.bool_]) -> None:
        """Project the image onto non-negative forces in each contact; their sum stays the same."""
        for patch in self._finder.patches:
            members = patch[known[patch]]
            force = self._estimator.force[members]
            if force.min(initial=0.0) < 0.0:
                self._image.force[members] = non_negative(force, self._variance[members])

    def _plausible(self, scan: Scan) -> bool:
        """Find saturated taxels; refuse a scan in which most are saturated, unless it persists."""
        self._inverse.read(scan.counts, self._readings)
        flags = self._saturated.tobytes()
        self._saturated_now = flags.count(1) if 1 in flags else 0
        if 2 * self._saturated_now <= len(flags):
            self._implausible_in_a_row = 0
            return True
        self._implausible_in_a_row += 1
        if self._implausible_in_a_row > MOST_IMPLAUSIBLE:
            return True
        self._clock.counts.implausible += 1
        return False

    def _has_burst(self, scan: Scan) -> bool:
        """Return whether the readings have a burst; count it."""
        found = self._bursts.is_burst(self._charge, scan.sequence, self._faults.faulty)
        self._clock.counts.bursts += found
        return found

    def _follow(self, step: float) -> tuple[Contact, ...]:
        """Measure the regions in contact and update the contacts."""
        if self._any_interpolated or self._result.saturated:
            estimate = self._make_estimate()  # of this scan alone
        else:
            estimate = self._estimate = self._estimate or self._make_estimate()
        return self._tracker.follow(self._finder, estimate, step)

    def _make_estimate(self) -> ForceEstimate:
        """Return the forces with their uncertainty at the end of the last block."""
        estimator, interpolated = self._estimator, None
        force, variance = estimator.force, estimator.force_variance(np.empty_like(self._variance))
        if self._any_interpolated:
            force, interpolated = self._filled, self._interpolated
            variance[interpolated] = _interpolation_variance(force[interpolated])
        return ForceEstimate(
            force,
            variance,
            saturated=self._saturated if self._result.saturated else None,
            unlisted=self._unlisted,
            interpolated=interpolated,
            correlated_error=estimator.correlated_error,
        )

    def _find_with_faulty(self) -> int:
        """Find the regions in contact, with the forces of faulty taxels interpolated from their neighbours."""
        force, faults = self._filled, self._faults
        force[:] = self._estimator.force
        force[self._interpolated] = 0.0
        regions = self._finder.find(force)
        if not regions:
            return regions
        unknown = self._interpolated | ~self._estimator.offset_known
        wanted = self._interpolated.nonzero()[0]
        force[wanted] = faults.surroundings.interpolate(force, unknown, wanted, self._least)
        return self._finder.find(force)

    def _close_block(self) -> None:
        """Correct baselines away from contacts, test the taxels, and set the thresholds by the new uncertainty."""
        estimator, faults = self._estimator, self._faults
        near = self._finder.dilated(self._finder.touched, self._contact_margin)
        variance = estimator.variance(self._variance)
        mean, charge = estimator.block_mean, estimator.residual_charge
        if not self._detects_faults:
            faults.measure_noise(estimator.block_time, self._saturated, near)
        elif faults.close_block(
            estimator.block_time, mean, variance, charge, self._saturated, near, estimator.offset_known
        ):
            estimator.ignore(faults.faulty)
        estimator.set_noise_variance(faults.noise_variance)
        self._bursts.set_usual_change(faults.usual_change)
        self._hum.close_block(self._finder.touched, faults.faulty | self._saturated, estimator.block_time)
        contacts = [contact.region.taxels for contact in self._result.contacts]
        estimator.close_block(self._finder.touched, contacts)
        self._choose_interpolated()
        self._set_thresholds()
        self._estimate = None

    def _choose_interpolated(self) -> None:
        """Choose the faulty taxels that are interpolated: not noisy ones that are still informative."""
        faults = self._faults
        self._any_interpolated, self._unlisted = False, None
        if not faults.any_faulty:
            return
        self._unlisted = faults.faulty.copy()
        informative = faults.informative(self._informative) & self._estimator.offset_known
        self._estimator.informative[:] = informative
        estimated = faults.faulty & ~informative
        self._filled[estimated & ~self._interpolated] = 0.0  # until the next scan
        self._interpolated[:] = estimated
        self._any_interpolated = bool(self._interpolated.any())

    def _set_thresholds(self) -> None:
        """Set the contact thresholds by the uncertainty of the forces."""
        estimator = self._estimator
        self._variance = estimator.variance(self._variance)
        if self._any_interpolated:
            self._variance[self._interpolated] = 0.0  # their forces are interpolated
        usable = (
            None if estimator.valid and not self._faults.any_faulty else estimator.offset_known | self._interpolated
        )
        self._finder.update_thresholds(estimator.force, self._variance, usable)


def _interpolation_variance(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance [N2] of forces [N] that are interpolated from the neighbours."""
    return np.square(INTERPOLATION_UNCERTAINTY * force)
