# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Hot path of the model: a scan in, forces and contacts out.

Compiled: `posfet_core`, reconstructor.hpp. What happens in every scan is in scan_path.hpp, what every 20 ms in
block_end.hpp: tests of the taxels, mains hum, estimation, thresholds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.detection import ENTER_DEVIATIONS, ContactFinder
from posfet_model.contacts.slip import DynamicChannel, Motion
from posfet_model.contacts.tracker import Contact, ContactState, ContactTracker
from posfet_model.estimation.force_estimator import ForceEstimator
from posfet_model.reconstruction.bursts import BurstDetector
from posfet_model.reconstruction.contacts_writer import ContactsWriter
from posfet_model.reconstruction.force_image import ForceImage, non_negative
from posfet_model.reconstruction.mains_hum import MainsHum
from posfet_model.reconstruction.scan_clock import ScanClock, ScanCounts
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.reconstruction.taxel_faults import INFORMATIVE, TaxelFaultDetector, TaxelStatus
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.neighbour_estimate import most_over_neighbours
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton, force_noise_rms, volts_per_count


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
    CONTACT_UNKNOWN = 32
    """Of a total only: that of a contact is unknown, as a taxel in it is faulty and no neighbour tells its force."""


@dataclass(slots=True, eq=False)
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
        return Reconstruction(*self._values())

    def _values(self) -> tuple[Any, ...]:
        """Return the values of the fields, in their order."""
        return (
            self.accepted,
            self.unusable,
            self.stamp,
            self.sequence,
            self.valid,
            self.contacts,
            dict(self.motions),
            self.saturated,
            self.reasons,
        )

    def serialise(self, writer: ContactsWriter) -> bytes:
        """Return the contacts as a serialised message.

        Parameters
        ----------
        writer : ContactsWriter
            What is the same in each message of the sensor.
        """
        return writer.write_contacts(self.stamp, self.sequence, self.valid, self.contacts, self.motions)


class _LastResult(Reconstruction):
    """Result of the last scan of a path: contacts and motions are made when they are asked for."""

    __slots__ = ("_made", "_path")

    def __init__(self, path: scan_path.ScanPath) -> None:
        super().__init__(False, False, 0, 0, False, (), {}, 0)
        self._path = path
        self._made = ["contacts", "motions"]
        self.forget()

    def forget(self) -> None:
        """Drop contacts and motions; they are made when they are asked for."""
        for name in self._made:
            delattr(self, name)
        self._made.clear()

    def __getattr__(self, name: str) -> Any:
        """Make an attribute that was forgotten."""
        if name not in ("contacts", "motions"):
            raise AttributeError(name)
        made = getattr(self._path, name)
        setattr(self, name, made)
        self._made.append(name)
        return made

    def __reduce__(self) -> tuple[type[Reconstruction], tuple[Any, ...]]:
        """Make copies results of their own."""
        return Reconstruction, self._values()

    def serialise(self, writer: ContactsWriter) -> bytes:
        """Return the contacts as a serialised message."""
        return writer.write_scan(self._path)


_REASONS: Final = tuple(InvalidReason(bits) for bits in range(32))
"""What the compiled path gives as bits."""


def total_reasons(result: Reconstruction, image: ForceImage) -> InvalidReason:
    """Return why the total force of a scan is not fit for control: its contacts may be, while one of them is unknown.

    Parameters
    ----------
    result : Reconstruction
        Result of the scan.
    image : ForceImage
        Force image of the scan.

    Returns
    -------
    InvalidReason
        The reasons; NONE if the total is fit for control.
    """
    known = result.reasons or math.isfinite(image.total)
    return result.reasons if known else InvalidReason.CONTACT_UNKNOWN


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
    first_id : int, default 1
        Id of the first contact.
    """

    def __init__(
        self,
        sensor: Sensor,
        calibration: Calibration | None = None,
        settings: ReconstructionSettings | None = None,
        first_id: int = 1,
    ) -> None:
        taxels = sensor.layout.taxels
        settings = settings or ReconstructionSettings()
        self.calibration = calibration or Calibration.nominal(sensor)
        """Properties of each taxel in use."""
        leaking = replace(
            sensor, device=replace(sensor.device, leak_time_constant=self.calibration.usual_leak_time_constant)
        )
        self._clock = ScanClock(leaking)
        self._estimator = ForceEstimator(sensor, settings.priors, self.calibration, settings.max_relative_uncertainty)
        self._estimator.touch_at_start = settings.touch_at_start
        noise = force_noise_rms(sensor)
        self._newton_per_charge = 1.0 / charge_per_newton(sensor)
        self._sensor, self._noise, self._settings = sensor, noise, settings
        self._hum = self._make_hum(settings)
        self._dynamic = DynamicChannel(sensor.layout, noise)
        self._finder = ContactFinder(sensor)
        self._finder.set_thresholds(settings.contact or sensor.contact)
        self._tracker = ContactTracker(sensor, first_id=first_id)
        self._faults = TaxelFaultDetector(leaking, known_dead=self.calibration.dead)
        self._bursts = BurstDetector(sensor)
        self._path = self._make_path()
        self._saturated, self._filled, self._interpolated = (
            self._path.saturated, self._path.filled, self._path.interpolated
        )  # fmt: skip
        self._block_end = self._make_block_end()
        self._block_end.detects_faults = settings.fault_detection
        self._compiled = scan_path.Reconstructor(self._path, self._block_end)
        self._variance = np.zeros(taxels)
        self._measured = np.zeros(taxels, np.bool_)
        """Taxels whose load is a reading, and no estimate by the neighbours."""
        self._errors = np.zeros((taxels, self._estimator.correlated_error.shape[1] + 1))
        """Factor of the errors that the forces share, as of the last `image`, shape [taxels, causes + 1]."""
        self._result = _LastResult(self._path)
        self._image = ForceImage.unknown(taxels)

    def _make_path(self) -> scan_path.ScanPath:
        """Return the compiled path of the parts."""
        sensor = self._sensor
        inverse = InverseSignalChain(sensor)
        low, high = inverse.saturated_counts
        most_x, most_y = most_over_neighbours(sensor)
        return scan_path.ScanPath(
            clock=self._clock,
            crosstalk=CrosstalkCompensator(sensor.layout, self.calibration.crosstalk),
            bursts=self._bursts,
            hum=self._hum,
            integration=self._estimator.integration,
            history=self._faults.history,
            finder=self._finder,
            tracker=self._tracker,
            channel=self._dynamic,
            volts_of_zero=sensor.adc.low,
            volts_per_count=volts_per_count(sensor),
            gain=sensor.amplifier.follower_gain,
            amplifier_offset=sensor.amplifier.offset,
            capacitance=sensor.device.film_capacitance,
            saturated_low=low,
            saturated_high=high,
            offset=self.calibration.offset * charge_per_newton(sensor) / sensor.volts_per_newton,
            informative=INFORMATIVE * self._noise,
            most_x=most_x,
            most_y=most_y,
        )

    def _make_block_end(self) -> scan_path.BlockEnd:
        """Return what closes the blocks of the path."""
        layout, spread = self._sensor.layout, self._sensor.device.contact_spread
        return scan_path.BlockEnd(
            path=self._path,
            estimator=self._estimator,
            faults=self._faults,
            bursts=self._bursts,
            hum=self._hum,
            finder=self._finder,
            margin=math.ceil(3.0 * spread / min(layout.pitch_x, layout.pitch_y)) + 1,
            informative=self._sensor.contact.threshold / ENTER_DEVIATIONS,
        )

    @property
    def vibration_wanted(self) -> bool:
        """Whether the dynamic channel runs while nothing touches, too, and averages the power of each taxel."""
        return self._path.vibration_wanted

    @vibration_wanted.setter
    def vibration_wanted(self, wanted: bool) -> None:
        """Set it."""
        self._path.vibration_wanted = wanted

    @property
    def counts(self) -> ScanCounts:
        """Numbers of scans and events since the start, by cause; a copy, which later scans do not change."""
        return self._clock.counts

    @property
    def next_id(self) -> int:
        """Id of the next contact."""
        return self._tracker.next_id

    @property
    def restarts(self) -> int:
        """Number of taxel restarts, each with an unknown offset, since the start."""
        return self._estimator.restarts

    @property
    def unsettled(self) -> int:
        """Number of taxels whose offset is unknown, of those that are not faulty."""
        return int(np.count_nonzero(~self._estimator.offset_known & ~self._faults.faulty))

    @property
    def faulty(self) -> int:
        """Number of dead, stuck and noisy taxels."""
        return int(np.count_nonzero(self._faults.faulty))

    @property
    def temperature_known(self) -> bool:
        """Whether a temperature sensor reports."""
        return self._estimator.integration.thermometers.known

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
        return self._compiled.maintenance_due

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
        accepted, unusable, valid, reasons, saturated = self._compiled.process(scan)
        result.accepted, result.unusable = accepted, unusable
        if accepted or unusable:
            result.stamp, result.sequence = scan.stamp, scan.sequence
            result.valid, result.reasons, result.saturated = valid, _REASONS[reasons], saturated
            result.forget()
        return result

    def make_sink(self, writer: ContactsWriter, mutex: scan_path.Mutex) -> scan_path.ContactsSink:
        """Return what takes scans without Python in place of `process`; what it has done is shown after `refresh`.

        Parameters
        ----------
        writer : ContactsWriter
            Serialises the contacts that are published.
        mutex : Mutex
            Held while a scan is processed.
        """
        return scan_path.ContactsSink(self._compiled, writer, mutex)

    def refresh(self) -> Reconstruction:
        """Return the result of the last scan, also of one that a sink has taken; overwritten by the next scan."""
        result = self._result
        result.accepted, result.unusable, result.valid, reasons, result.saturated, result.stamp, result.sequence = (
            self._path.result
        )
        result.reasons = _REASONS[reasons]
        result.forget()
        return result

    def run_maintenance(self) -> None:
        """Run the block maintenance now, after the results of a scan were published, instead of in the next `process`.

        Every 20 ms baselines are corrected and taxels tested, which takes several times as long as a scan.
        """
        self._compiled.run_maintenance()

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
            self._block_end.set_hum(self._hum)
        self._estimator.max_relative_uncertainty = settings.max_relative_uncertainty
        self._estimator.touch_at_start = settings.touch_at_start
        self._block_end.detects_faults = settings.fault_detection
        self._finder.set_thresholds(settings.contact or self._sensor.contact)
        self._block_end.set_thresholds()

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
        result = self.refresh()
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
        self._block_end.set_thresholds()
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
        shared = self._shared_errors()
        each = self._variance + np.einsum("ij,ij->i", shared, shared)
        np.sqrt(each, out=image.standard_deviation, casting="same_kind")
        self.status()
        if self._path.blank:
            known = np.zeros_like(known)
        if faults.any_faulty or not estimator.valid or self._path.blank:
            image.force[~known] = math.nan
            image.standard_deviation[~known] = math.nan
        self._set_total(known)
        if self._result.saturated:
            bounded = self._saturated & ~faults.faulty
            if bounded.any():
                image.standard_deviation[bounded] = math.nan
                image.total_standard_deviation = math.nan
        return image

    def status(self) -> NDArray[np.uint8]:
        """Return the status of each taxel at the last scan (TaxelStatus), which is a part of the force image.

        Returns
        -------
        ndarray
            Shape [rows * cols]; overwritten by the next call and that of `image`.
        """
        status, faults = self._image.status, self._faults
        status[:] = faults.status
        if self._result.saturated:
            status[self._saturated & ~faults.faulty] = TaxelStatus.SATURATED
        return status

    def _shared_errors(self) -> NDArray[np.float64]:
        """Return a factor of the errors that the forces share, with that of what they changed by since the block."""
        estimator, integration = self._estimator, self._estimator.integration
        self._errors[:, :-1] = estimator.correlated_error
        np.subtract(estimator.force, integration.held, out=self._errors[:, -1])
        self._errors[:, -1] *= integration.rise_deviation
        return self._errors

    def _set_total(self, known: NDArray[np.bool_]) -> None:
        """Set the loads and their sum: those of faulty taxels as contacts estimate them."""
        image, estimator = self._image, self._estimator
        image.total, image.total_standard_deviation = math.nan, math.nan
        image.load.fill(0.0)
        image.load_variance.fill(0.0)
        if not known.any():
            return
        self._measured[:] = known
        np.copyto(image.load, image.force, where=known)
        if self._faults.any_faulty:
            own = self._faults.faulty & ~self._interpolated
            self._measured |= own
            np.copyto(image.load, estimator.force, where=own)
        np.copyto(image.load_variance, self._variance, where=self._measured)
        image.total = float(estimator.force.sum(where=self._measured))
        if self._result.contacts and self._faults.any_faulty:
            np.copyto(image.load, self._interpolated_loads(), where=self._interpolated)
            np.copyto(image.load_variance, np.square(self._path.filled_deviation), where=self._interpolated)
            image.total += float(image.load.sum(where=self._interpolated))
        variance = float(image.load_variance.sum())  # NaN: a taxel without a usable neighbour
        shared = self._errors.sum(axis=0, where=self._measured[:, np.newaxis])
        image.total_standard_deviation = math.sqrt(variance + float(np.square(shared).sum()))

    def _interpolated_loads(self) -> NDArray[np.float64]:
        """Return the loads of interpolated taxels [N]; of one that no neighbour tells NaN in a contact, else 0."""
        unknown = self._interpolated & np.isnan(self._filled)
        if not unknown.any():
            return self._filled
        loads = np.nan_to_num(self._filled)
        for patch in self._finder.patches:
            loads[patch[unknown[patch]]] = math.nan
        return loads

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
        image = self._image
        if math.isnan(image.total_standard_deviation):
            return np.full((len(weights), len(weights)), math.nan)
        shared = np.where(self._measured, weights, 0.0) @ self._errors
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
        vibration[self._faults.faulty | self._saturated | self._path.blank] = math.nan
        return vibration

    def _keep_non_negative(self, known: NDArray[np.bool_]) -> None:
        """Project the image onto non-negative forces in each contact; their sum stays the same."""
        for patch in self._finder.patches:
            members = patch[known[patch]]
            force = self._estimator.force[members]
            if force.min(initial=0.0) < 0.0:
                self._image.force[members] = non_negative(force, self._variance[members])
