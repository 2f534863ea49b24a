"""The hot path of the model: a scan in, forces and contacts out. Everything is allocated once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.detection import ENTER_DEVIATIONS, ContactFinder, Taxels
from posfet_model.contacts.footprint import Footprint
from posfet_model.contacts.slip import FastChannel, Motion
from posfet_model.contacts.tracker import Contact, ContactState, ContactTracker
from posfet_model.estimation.force_observer import ForceObserver
from posfet_model.reconstruction.force_image import ForceImage, non_negative
from posfet_model.reconstruction.mains_hum import MainsHum
from posfet_model.reconstruction.scan_clock import ScanClock, ScanCounts
from posfet_model.reconstruction.taxel_faults import TELLING, TaxelStatus, TaxelWatch
from posfet_model.sensor.crosstalk import CrosstalkInverse
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.neighbour_estimate import ESTIMATE_DEVIATION
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import READING, InverseChain, charge_per_newton, noise_of_a_scan

MOST_IMPLAUSIBLE: Final = 10
"""After this many scans in a row with most taxels at the end of their range it is taken for true."""


@dataclass(slots=True)
class Reconstruction:
    """Result of the last scan.

    A reconstructor reuses the same object for every scan: `snapshot` returns a copy that stays.
    """

    accepted: bool
    """False: the scan was refused."""
    unusable: bool
    """The scan was refused for what is in it: stamp and sequence are its own, contacts those of the scan before, and
    `valid` is false. A scan that came twice or late is refused, too, and leaves everything as it was."""
    stamp: int
    """Acquisition time [ns] since the Unix epoch."""
    sequence: int
    valid: bool
    """False: not fit for control."""
    contacts: tuple[Contact, ...]
    """Ascending by id; released ones once."""
    motions: dict[int, Motion]
    """What the fast channel says of each contact that is not released, by its id."""
    saturated: int
    """Number of taxels at the end of their range."""

    def snapshot(self) -> Reconstruction:
        """Return an independent copy, which the next scan does not overwrite."""
        return replace(self, motions={number: replace(motion) for number, motion in self.motions.items()})


@dataclass(frozen=True, eq=False)
class Tare:
    """What a tare did."""

    done: bool
    message: str
    """What was changed, or why not, in one line."""
    force_change: NDArray[np.float64]
    """What was added to each force [N], shape [rows * cols]; empty when refused."""


class Reconstructor:
    """Forces and contacts of one sensor, scan by scan."""

    def __init__(self, sensor: Sensor, calibration: Calibration | None = None) -> None:
        """Take the sensor, and what is known of its taxels beyond its description."""
        taxels = sensor.layout.taxels
        self.calibration = calibration or Calibration.nominal(sensor)
        self._clock = ScanClock(sensor)
        self._inverse = InverseChain(sensor)
        self._crosstalk = CrosstalkInverse(sensor.layout, self.calibration.crosstalk)
        self._observer = ForceObserver(sensor, calibration=self.calibration)
        noise = noise_of_a_scan(sensor)
        self._newton_per_charge = 1.0 / charge_per_newton(sensor)
        self._hum = MainsHum(taxels, sensor.can.scan_rate, noise / self._newton_per_charge)
        self._fast = FastChannel(sensor.layout, noise)
        self.vibration_wanted = False
        """Whether the fast channel runs while nothing touches, too, and averages the power of each taxel."""
        self._finder = ContactFinder(sensor)
        self._tracker = ContactTracker(sensor)
        self._watch = TaxelWatch(sensor, known_dead=self.calibration.dead)
        self._observer.ignore(self._watch.bad)
        self._least = TELLING * noise
        pitch = min(sensor.layout.pitch_x, sensor.layout.pitch_y)
        self._reach = math.ceil(3.0 * sensor.device.contact_spread / pitch) + 1
        self._readings = np.zeros(taxels, READING)
        self._charge, self._saturated = self._readings["charge"], self._readings["saturated"]
        volts_per_charge = sensor.volts_per_newton / charge_per_newton(sensor)
        self._offset_charge = self.calibration.offset / volts_per_charge
        self._any_offset = bool(self._offset_charge.any())
        self._filled = np.zeros(taxels)
        self._variance = np.zeros(taxels)
        self._known: Taxels | None = None
        self._guessed = np.zeros(taxels, np.bool_)
        self._telling = sensor.contact.threshold / ENTER_DEVIATIONS
        self._choose_guessed()
        self._set_thresholds()
        self._saturated_now = 0
        self._implausible_in_a_row = 0
        self._result = Reconstruction(False, False, 0, 0, False, (), {}, 0)
        self._image = ForceImage(
            np.full(taxels, np.nan, np.float32),
            np.full(taxels, np.nan, np.float32),
            np.zeros(taxels, np.uint8),
            math.nan,
            math.nan,
        )

    @property
    def counts(self) -> ScanCounts:
        """Scans counted by what became of them."""
        return self._clock.counts

    @property
    def restarts(self) -> int:
        """Taxels that had to find their zero anew since the start."""
        return self._observer.restarts

    @property
    def unsettled(self) -> int:
        """Taxels whose offset is not known yet."""
        return int(np.count_nonzero(~self._observer.settled))

    @property
    def bad(self) -> int:
        """Taxels that do not work."""
        return int(np.count_nonzero(self._watch.bad))

    @property
    def temperature_known(self) -> bool:
        """Whether a temperature sensor is known."""
        return self._observer.film.known

    @property
    def rate(self) -> float:
        """Scans per second by the board's clock [Hz]."""
        return self._clock.rate

    @property
    def hum_frequency(self) -> float:
        """Of the mains hum that is taken away [Hz]; NaN: there is none."""
        return self._hum.frequency

    @property
    def hum_amplitude(self) -> float:
        """Of the mains hum that is taken away, root mean square of the taxels [N]."""
        return self._hum.amplitude * self._newton_per_charge

    @property
    def untidy(self) -> bool:
        """Whether `tidy` has something to do."""
        return self._observer.block_due

    def process(self, scan: Scan) -> Reconstruction:
        """Take one scan; the result is overwritten by the next call."""
        result = self._result
        clock, observer = self._clock, self._observer
        if observer.block_due:
            self._close_block()
        result.unusable = not (clock.fits(scan) and self._plausible(scan))
        result.accepted = not result.unusable and clock.admit(scan)
        if not result.accepted:
            return self._flag(scan) if result.unusable else result
        if self._any_offset:
            self._charge -= self._offset_charge
        charge = self._crosstalk.apply(self._charge) if self._crosstalk.present else self._charge
        if clock.interrupted:
            observer.interrupt()
            self._fast.pause()
            self._hum.interrupt()
            self._known = None
        if self._hum.listening:
            self._hum.remove(charge, clock.step)
        observer.advance(charge, scan.temperatures, clock.step)
        result.saturated = self._saturated_now
        if result.saturated:
            observer.lose(self._saturated, clock.step)
        observer.follow_common(not self._tracker.idle)
        self._watch.take(scan.counts)
        regions = self._find_around_bad() if self._any_guessed else self._finder.find(observer.force)
        if regions or self.vibration_wanted:
            self._fast.advance(observer.change, clock.step)
            if self.vibration_wanted:
                self._fast.average(clock.step)
        else:
            self._fast.pause()
        if regions or not self._tracker.idle:
            result.contacts = self._follow(regions, clock.step)
            result.motions = self._fast.follow(result.contacts, observer.force, clock.step)
        elif result.contacts:
            result.contacts = ()
        result.stamp = scan.stamp
        result.sequence = scan.sequence
        result.valid = observer.valid and not clock.suspect
        return result

    def tidy(self) -> None:
        """Do what can wait until the results of a scan are out; the next call of `process` does it otherwise.

        Every 20 ms zeros are corrected and taxels judged, which takes several times as long as a scan.
        """
        if self._observer.block_due:
            self._close_block()

    def tare(self) -> Tare:
        """Make zero of what is read while nothing touches; refused under load, and while zeros are still looked for."""
        self.tidy()
        result = self._result
        live = [contact for contact in result.contacts if contact.state is not ContactState.RELEASED]
        none = np.zeros(0)
        if live:
            total = sum(contact.region.force for contact in live)
            return Tare(False, f"refused under load: contacts: {len(live)}, force: {total:.3f} N; lift first", none)
        if not result.valid:
            return Tare(
                False, "refused: no valid forces yet; check that scans come, and leave the sensor at rest", none
            )
        change = self._observer.tare()
        largest = int(np.abs(change).argmax())
        moved = float(change[largest])
        return Tare(True, f"zeros moved by {moved * 1e3:+.3f} mN at most (taxel {largest})", change)

    def image(self) -> ForceImage:
        """Return the forces of the last scan taken; overwritten by the next call."""
        image, observer, watch = self._image, self._observer, self._watch
        known = observer.settled & ~watch.bad if watch.any_bad else observer.settled
        self._variance = observer.variance(self._variance)
        common = observer.common_variance
        np.copyto(image.force, observer.force, casting="same_kind")
        if self._result.contacts:
            self._keep_non_negative(known)
        self._variance = observer.force_variance(self._variance)
        np.sqrt(self._variance + common, out=image.standard_deviation, casting="same_kind")
        image.status[:] = watch.status
        if self._result.unusable:
            known = np.zeros_like(known)
        if watch.any_bad or not observer.valid or self._result.unusable:
            image.force[~known] = math.nan
            image.standard_deviation[~known] = math.nan
        image.total, image.total_standard_deviation = math.nan, math.nan
        count = int(np.count_nonzero(known))
        if count:
            image.total = float(observer.force.sum(where=known))
            shared = float(observer.shared_error.sum(where=known)) ** 2 + count * count * common
            variance = float(self._variance.sum(where=known)) + shared
            image.total_standard_deviation = math.sqrt(variance)
        if self._result.saturated:
            image.status[self._saturated & ~watch.bad] = TaxelStatus.SATURATED
            image.standard_deviation[self._saturated] = math.nan
            image.total_standard_deviation = math.nan
        return image

    def vibration(self) -> NDArray[np.float32]:
        """Return the RMS of each taxel's force above the corner of the fast channel [N], shape [rows * cols].

        NaN where a taxel does not work. For while `vibration_wanted`.
        """
        vibration = np.sqrt(self._fast.power).astype(np.float32)
        vibration[self._watch.bad | self._saturated | self._result.unusable] = math.nan
        return vibration

    def _flag(self, scan: Scan) -> Reconstruction:
        """Take note of a scan that cannot be used: what touches goes on as it was, and none of it is valid."""
        result = self._result
        result.stamp, result.sequence, result.valid = scan.stamp, scan.sequence, False
        result.contacts = tuple(contact for contact in result.contacts if contact.state is not ContactState.RELEASED)
        return result

    def _keep_non_negative(self, known: NDArray[np.bool_]) -> None:
        """Take what is below zero in the image off the rest of its contact, of which the sum stays."""
        for patch in self._finder.patches:
            members = patch[known[patch]]
            force = self._observer.force[members]
            if force.min(initial=0.0) < 0.0:
                self._image.force[members] = non_negative(force, self._variance[members])

    def _plausible(self, scan: Scan) -> bool:
        """Look for taxels at the end of their range; refuse a scan in which most are, unless it goes on."""
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

    def _follow(self, regions: list[Footprint], step: float) -> tuple[Contact, ...]:
        """Measure the regions in contact and continue the contacts."""
        taxels = self._known or self._know()
        if self._any_guessed:
            variance = taxels.variance.copy()
            variance[self._guessed] = (ESTIMATE_DEVIATION * self._filled[self._guessed]) ** 2
            taxels = replace(taxels, force=self._filled, variance=variance, guessed=self._guessed)
        if self._result.saturated:
            taxels = replace(taxels, saturated=self._saturated)
        return self._tracker.update(self._finder.measure(regions, taxels, self._tracker.regions), step)

    def _know(self) -> Taxels:
        """Return what is known of the forces as of the last block: until the next one it stays the same."""
        observer = self._observer
        variance = observer.force_variance(np.empty_like(self._variance))
        common, shared = observer.common_variance, observer.shared_error
        self._known = Taxels(observer.force, variance, common, unlisted=self._unlisted, shared_error=shared)
        return self._known

    def _find_around_bad(self) -> list[Footprint]:
        """Find the regions in contact with what the bad taxels should read in place of what they do."""
        force, watch = self._filled, self._watch
        force[:] = self._observer.force
        force[self._guessed] = 0.0
        regions = self._finder.find(force)
        if not regions:
            return regions
        unknown = self._guessed | ~self._observer.settled
        wanted = self._guessed.nonzero()[0]
        force[wanted] = watch.surroundings.estimate(force, unknown, wanted, self._least)
        return self._finder.find(force)

    def _close_block(self) -> None:
        """Let the observer correct its zeros away from contacts, and set the thresholds by what it knows then."""
        observer, watch = self._observer, self._watch
        near = self._finder.around(self._finder.touched, self._reach)
        if watch.judge(observer.block_time, observer.block_mean, observer.leaking, self._saturated, near):
            observer.ignore(watch.bad)
        observer.know_noise(watch.noise_variance)
        self._hum.close_block(self._finder.touched, watch.bad | self._saturated, observer.block_time)
        observer.close_block(near)
        self._choose_guessed()
        self._set_thresholds()
        self._known = None

    def _choose_guessed(self) -> None:
        """Choose the bad taxels for which their neighbours speak: not noisy ones that tell a touch from none."""
        watch = self._watch
        self._any_guessed, self._unlisted = False, 0
        if not watch.any_bad:
            return
        self._unlisted = self._finder.bits(watch.bad)
        telling = watch.telling(self._telling) & self._observer.settled
        np.logical_and(watch.bad, ~telling, out=self._guessed)
        self._any_guessed = bool(self._guessed.any())

    def _set_thresholds(self) -> None:
        """Let contacts be only where a force is told from none."""
        observer = self._observer
        self._variance = observer.variance(self._variance)
        if self._any_guessed:
            self._variance[self._guessed] = 0.0  # what stands for them comes from their neighbours
        usable = None if observer.valid and not self._watch.any_bad else observer.settled | self._guessed
        self._finder.adapt(observer.force, self._variance, observer.common_variance, usable)
