# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Static force from the leaking charge signal: drift-compensated integration.

The charge of a held force leaks with the time constant tau. In units of force, x = sigma*A/(-d33), a scan at the end of
a step h gives the change of the force (the inverse of the first-order hold, charge.py):

    dF = (x1 - x0)/m + (h/tau)*(x0 - o) - dTheta*p*A/(-d33),    m = (1 - exp(-h/tau))/(h/tau)

with the residual offset o of the amplifier. F is the sum of the dF, and holds as long as the force does. Two errors
accumulate in it: white noise s per scan makes a random walk of variance s^2*(h/tau)^2 per scan, and an error e of the
offset makes a ramp -e*t/tau. Where nothing touches, F is its own error: a Kalman filter (drift_filter.py) estimates
offset and baseline from its mean over blocks of scans there. Elsewhere their uncertainty grows. An error of tau shows
while a force is held, and when it is released: leakage_identification.py estimates tau.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import any_true
from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.common_mode import CommonModeTemperature
from posfet_model.estimation.common_mode_correction import CommonModeCorrector
from posfet_model.estimation.drift_filter import DriftFilter
from posfet_model.estimation.film_temperature import FilmTemperature
from posfet_model.estimation.leakage_identification import LeakageIdentifier
from posfet_model.estimation.leakage_inverse import LeakageInverse
from posfet_model.estimation.rest_detector import RestDetector
from posfet_model.estimation.settings import (
    LARGE_UNCERTAINTY,
    LONG_STEP,
    OFFSET_SPREAD,
    REJECTED,
    RESTART_DEVIATION,
    RUNAWAY,
    TRANSIENT_WEIGHT,
    ObserverSettings,
)
from posfet_model.estimation.thermal_uncertainty import ThermalUncertainty
from posfet_model.estimation.validity import LowerBoundMonitor, NegativeForceMonitor
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms


class ForceObserver:
    """Force of every taxel with its variance, from charge densities; arrays row by row, shape [rows * cols].

    Call `advance` for each scan, and `close_block` whenever `block_due` is true. The force at the start is assumed to
    be zero: a taxel that is loaded then reads zero, a negative force once the load is released, and zero again soon
    after that.

    State variables: forces [N]; offsets [N] and their covariance with the force errors [N2] (`DriftFilter`); film
    temperature [K] (`FilmTemperature`); leakage time constants [s] (`LeakageIdentifier`); sums over the current block.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    settings : ObserverSettings, optional
        Settings; None: the defaults.
    calibration : Calibration, optional
        Properties of each taxel; None: nominal ones from the description.
    """

    def __init__(
        self, sensor: Sensor, settings: ObserverSettings | None = None, calibration: Calibration | None = None
    ) -> None:
        taxels = sensor.layout.taxels
        device = sensor.device
        calibration = calibration or Calibration.nominal(sensor)
        self._settings = settings or ObserverSettings()
        gain = calibration.usable_gain
        newton_per_charge = 1.0 / (charge_per_newton(sensor) * gain)
        newton_per_kelvin = device.pyroelectric_coefficient / charge_per_newton(sensor)
        self._per_kelvin = newton_per_kelvin * calibration.pyroelectric_gain / gain
        noise = force_noise_rms(sensor)
        self._noise_variance = np.full(taxels, noise**2)
        s, calibrated = self._settings, calibration.residuals is not None
        common, individual, mismatch = (
            s.leakage_common_deviation,
            s.leakage_individual_deviation,
            s.pyroelectric_mismatch,
        )
        if calibrated:
            common, individual = s.leakage_common_deviation_calibrated, s.leakage_individual_deviation_calibrated
            mismatch = s.pyroelectric_mismatch_calibrated
        self._leakage = LeakageIdentifier(calibration.leak_time_constant, self._noise_variance, common, individual)
        self._tau = self._leakage.time_constant
        self._inverse = LeakageInverse(self._tau, newton_per_charge)
        self._long_step = LONG_STEP * float(self._tau.min())
        self._prior = self._settings.initial_deviation / sensor.volts_per_newton
        flicker = (s.flicker / sensor.volts_per_newton) ** 2
        temperature_drift = (s.temperature_random_walk * newton_per_kelvin) ** 2
        self._drift = DriftFilter(self._tau, self._noise_variance, flicker, temperature_drift)
        self._slew = self._settings.baseline_slew * sensor.contact.threshold
        self._large_variance = (LARGE_UNCERTAINTY * sensor.contact.threshold) ** 2
        self._threshold = sensor.contact.threshold
        self._runaway = RUNAWAY * device.force_max
        self._known_offset = (0.5 * sensor.contact.threshold * self._tau) ** 2
        lag = calibration.thermal_time_constant
        self.film = FilmTemperature(device.thermal_time_constant if lag is None else lag)
        self.common = CommonModeTemperature(self.film, newton_per_kelvin, sensor.contact.threshold, noise)
        self._thermal = ThermalUncertainty(self.film, self.common, self._per_kelvin, mismatch, calibrated)
        self.force = np.zeros(taxels)
        """Estimated force [N], positive when pushed; valid where `offset_known`. Owned by the observer."""
        self.offset_known = np.zeros(taxels, np.bool_)
        """Taxels whose offset is known."""
        self.ignored = np.zeros(taxels, np.bool_)
        """Faulty taxels: `valid` does not depend on them. Set by `ignore`."""
        self.valid = self._any_ignored = False
        """Whether the forces of all taxels are valid."""
        self.restarts = 0
        """Number of restarts of taxels whose signal was consistent with no force."""
        spread, tau = OFFSET_SPREAD * sensor.contact.threshold, float(self._tau.max())
        self._rest = RestDetector(taxels, noise, spread, s.settle_time, tau)
        self._started, self._recovering = False, 0.0
        self._lower_bound = LowerBoundMonitor(taxels, self._threshold, s.recovery_time)
        self._make_state(taxels)
        self._corrector = CommonModeCorrector(
            self.force, self._drift, self._leakage, self._thermal, sensor.contact.threshold
        )
        self._start_block()

    def _make_state(self, taxels: int) -> None:
        self._change, self._scale_variance = np.zeros((2, taxels))
        self._prior_deviation = np.full(taxels, self._prior)
        self._was_touched = np.zeros(taxels, np.bool_)
        self._negative = NegativeForceMonitor(taxels, self._settings.steady_time)
        self._agreed, self._last_mean, self._sum = np.zeros((3, taxels))
        self._rest_force = np.zeros(taxels)  # mean of the last block, with the corrections at its end
        self._jumped = np.zeros(taxels)  # variance due to long steps in the current block

    @property
    def block_due(self) -> bool:
        """Whether `close_block` must be called before the next scan."""
        return self._elapsed >= self._settings.block

    @property
    def common_variance(self) -> float:
        """Variance common to all taxels, due to the film temperature [N2]."""
        thermal = self._thermal.common_variance
        return max(thermal, self._corrector.offset.variance) if thermal else thermal

    def variance(self, out: Array) -> Array:
        """Return in `out` the variance of `force` without the common one and without scale errors.

        Parameters
        ----------
        out : ndarray of float64, shape [rows * cols]
            Overwritten by the result.

        Returns
        -------
        ndarray of float64, shape [rows * cols]
            Variance of each force [N2], of a force of zero.
        """
        more = self._thermal.mismatch_variance
        return np.add(self._drift.variance, self._noise_variance + more if more else self._noise_variance, out=out)

    def force_variance(self, out: Array) -> Array:
        """Return in `out` the variance of `force`, with scale errors of gain and leakage, without what forces share.

        Scale errors are those at the end of the last block: a touch that began since then is not included yet.

        Parameters
        ----------
        out : ndarray of float64, shape [rows * cols]
            Overwritten by the result.

        Returns
        -------
        ndarray of float64, shape [rows * cols]
            Variance of each force [N2].
        """
        np.add(self.variance(out), self._scale_variance, out=out)
        return np.subtract(out, self._leakage.correlated_error**2, out=out)

    @property
    def correlated_error(self) -> Array:
        """Error of each force for one standard deviation of the common leakage error [N], shape [rows * cols, 1]."""
        return self._leakage.correlated_error[:, None]

    @property
    def block_time(self) -> float:
        """Duration of the current block so far [s]."""
        return self._elapsed

    @property
    def block_mean(self) -> Array:
        """Mean of `force` over the block that is due [N], shape [rows * cols]."""
        return self._sum / self._scans

    @property
    def residual_charge(self) -> Array:
        """Charge at each gate, as the force that would generate it [N], shape [rows * cols]."""
        return self._inverse.signal - self._drift.offset

    @property
    def change(self) -> Array:
        """Change of each force in the last step according to the signals [N], shape [rows * cols]."""
        return self._change

    def ignore(self, taxels: Mask) -> None:
        """Set the faulty taxels, shape [rows * cols]; one that works again restarts with an unknown offset."""
        back = self.ignored & ~taxels
        self.ignored[:] = taxels
        self._any_ignored = bool(taxels.any())
        self._corrector.set_usable(~taxels)
        if back.any():
            self._restart(back)

    def set_noise_variance(self, variance: Array) -> None:
        """Set the variance of a reading of each taxel [N2], shape [rows * cols]; initially that of the description."""
        self._noise_variance[:] = variance
        self._drift.noise_variance[:] = variance

    def interrupt(self) -> None:
        """Record that an unknown time passes before the next scan: changes of the force in it are unknown.

        Offsets stay known. At the next scan the force is set to the remaining charge, a lower bound of the force.
        """
        self._started = False
        self.valid = False
        self._recovering = self._settings.resume_time
        self._leakage.restart_window()
        self._corrector.offset.reset()

    def advance(self, charge: Array, temperatures: NDArray[np.float32], step: float) -> None:
        """Process a scan.

        Parameters
        ----------
        charge : ndarray of float64, shape [rows * cols]
            Charge densities [C/m2].
        temperatures : ndarray of float32, shape [sensors]
            Chip temperatures [degC]; NaN: unknown.
        step : float
            Time since the previous scan [s], > 0.
        """
        warmed = self.film.update(temperatures, step)
        if not self._started:
            self._start(charge)
            return
        change, force, total = self._change, self.force, self._sum
        coefficients = self._inverse.advance(charge, self._drift.offset, step, change)
        if warmed:
            change -= warmed * self._per_kelvin
            self._thermal.rise += warmed
            self._corrector.film_rise += warmed
        force += change
        total += force
        self._scans += 1
        self._elapsed += step
        self._elapsed_square += step * step
        if step > self._long_step:
            # The charge of a jump within the step leaked by a share of h/tau that is unknown, uniformly distributed.
            self._jumped += (change * coefficients.ratio) ** 2 / 12.0
            self._drift.variance[:] += (change * coefficients.ratio) ** 2 / 12.0
            self._leakage.restart_window()

    def compensate_common_mode(self, touched: bool) -> None:
        """Attribute the common-mode component of the forces to the film temperature; `touched`: something touches."""
        if not self._settings.common_mode or not self.valid or not (touched or self.common.active):
            return
        self._corrector.compensate(self.force[~self.ignored] if self._any_ignored else self.force, touched)

    def tare(self, forced: bool = False) -> Array:
        """Set the forces to zero, and start a new block; offsets stay, as they are estimated all the time.

        Parameters
        ----------
        forced : bool, optional
            Whether forces may be applied: those of the newest scan are set to zero, and none remains a lower bound.
            Otherwise the mean forces of the last block are set to zero, which have less noise.

        Returns
        -------
        ndarray of float64, shape [rows * cols]
            Correction that was added to each force [N]; 0 for ignored taxels.
        """
        change = np.where(self.ignored, 0.0, -self.force if forced else -self._rest_force)
        if forced:
            self._leakage.restart_window()
            self._negative.reset(slice(None))
            self._lower_bound.mask[:] = False
        self._shift_baseline(change)
        self._rest_force += change
        self._drift.reset_force_error(slice(None), self._noise_variance)
        self._drift.forget()
        self._start_block()
        return change

    def inflate_variance(self, saturated: Mask, step: float) -> None:
        """Increase the variance of saturated taxels by the leakage that the clipped signal does not show.

        Parameters
        ----------
        saturated : ndarray of bool, shape [rows * cols]
            Taxels at the end of their range.
        step : float
            Time since the previous scan [s].
        """
        lost = np.abs(self._inverse.signal[saturated]) * (step / self._tau[saturated])
        variance = self._drift.variance
        variance[saturated] = (np.sqrt(variance[saturated]) + lost) ** 2

    def close_block(self, touched: Mask, near: Mask, contacts: Sequence[NDArray[np.intp]] = ()) -> None:
        """Correct baseline and offset where nothing touched during the block; propagate the covariance elsewhere.

        Parameters
        ----------
        touched : ndarray of bool, shape [rows * cols]
            Taxels in contact at any time of the block; not used.
        near : ndarray of bool, shape [rows * cols]
            Taxels in or near a contact at any time of the block. Has no effect where the offset is unknown: there a
            constant force is as informative as no force.
        contacts : sequence of ndarray of int
            Taxels of each contact; not used.
        """
        touched = near
        s, drift = self._settings, self._drift
        mean = self._sum / self._scans
        deviation = mean - self.force  # of the mean from the last scan
        if self._corrector.due:
            self._corrector.measure(self._leaked, self._elapsed, self._scans)
        self._corrector.subtract_common_mode(mean, touched, self.common.observable)
        noise = self._noise_variance / self._scans
        self._predict()
        if any_true(self._was_touched):
            self._corrector.update_touched(self._elapsed)
        self._process_touches(touched & self.offset_known, mean)
        # The error of the film temperature is constant during the block: averaging does not reduce it.
        expected = drift.innovation_variance(self._elapsed, noise + self.common_variance)
        agrees = mean * mean <= s.gate * s.gate * (expected + self._thermal.film_variance)
        free = ~touched | ~self.offset_known
        if any_true(where := free & agrees):
            self._correct(where, mean, expected)
        if any_true(where := free & self.offset_known & ~agrees):
            # Neither a contact nor an expected error: tracked slowly.
            low, high = -s.baseline_rise * self._threshold * self._elapsed, self._slew * self._elapsed
            self._shift_baseline(-np.where(where, np.clip(mean, low, high), 0.0))
        self._correct_negative(free & self.offset_known, mean, noise, expected)
        unknown_affected, known_affected = self._corrector.learnt_during_warming(self._elapsed)
        self.offset_known &= not known_affected
        failed = ~self.offset_known & (~agrees | unknown_affected)
        failed |= np.abs(self.force) > self._runaway
        failed |= self._negative.duration >= s.recovery_time
        # While the film differs from its estimate, the common mode can look like an offset for some time.
        self._agreed += self._elapsed * (1.0 if self.film.steady else TRANSIENT_WEIGHT)
        if any_true(failed):
            again = failed & ~self.offset_known
            self._prior_deviation[again] = np.minimum(REJECTED * self._prior_deviation[again], self._runaway)
            self.restarts += int(np.count_nonzero(failed & ~self.ignored))
            self._restart(failed)
        self._confirm_offsets()
        self._recovering = max(0.0, self._recovering - self._elapsed)
        self._lower_bound.update(mean, self._elapsed)
        sound = self.offset_known & (self._negative.duration == 0.0) & ~self._lower_bound.mask | self.ignored
        self.valid = self._recovering == 0.0 and not any_true(~sound)
        self._last_mean = mean
        signal = self._inverse.signal
        self._corrector.close_block(mean, any_true(touched), signal, self.offset_known, self.valid, self._elapsed)
        self._rest_force = self.force + deviation
        drift.store(mean, noise)
        self._start_block()

    def _correct_negative(self, where: Mask, mean: Array, noise: Array, expected: Array) -> None:
        """Correct baselines that were set under load: negative forces are impossible."""
        gate = self._settings.gate
        limit = np.maximum(self._threshold, gate * np.sqrt(expected))
        still = np.abs(mean - self._last_mean) <= gate * np.sqrt(2.0 * noise)
        confirmed = self._negative.update(where, mean, limit, still, self._elapsed)
        if any_true(confirmed):
            self.force[confirmed] -= mean[confirmed]
            self._drift.reset_force_error(confirmed, self._noise_variance[confirmed])

    def _confirm_offsets(self) -> None:
        """Mark offsets as known once the array has been still."""
        if self.offset_known.all():
            return
        signal = self._inverse.signal - self._thermal.residual_signal
        at_rest = self._rest.update(signal, self.ignored, self._elapsed, not self.film.steady)
        if self._rest.moved:
            self._restart(~self.offset_known)
        elif at_rest:
            long_enough = self._agreed >= self._settings.settle_time
            self.offset_known |= long_enough & (self._drift.offset_variance <= self._known_offset)

    def _process_touches(self, touched: Mask, mean: Array) -> None:
        """Roll back taxels on which a touch begins, and estimate leakage time constants from touched taxels."""
        leakage, begun = self._leakage, touched & ~self._was_touched
        if any_true(begun):
            blocks = np.zeros(np.count_nonzero(begun), np.intp)
            if self._settings.roll_back:
                change, blocks = self._drift.roll_back(begun)
                self.force[begun] += change
            if self.valid and not any_true(self._was_touched):
                self._corrector.begin_touch(begun, blocks, self._elapsed)
            self._drift.variance[begun] += self._jumped[begun]
            leakage.begin_touch(begun, self._leaked)
            self._thermal.begin_touch(begun)
        if any_true(touched):
            if not self.film.steady:
                leakage.restart_window()  # pyroelectric charge leaks, too, and is not known well enough for a fit
            leakage.add_block(self._elapsed, self._scans, mean, self._leaked, touched & self._was_touched)
            correction = leakage.update(touched, self._thermal.observed_leakage)
            if correction is not None:
                self.force += correction
                self._inverse.invalidate_time_constants()
                self._corrector.offset.time_constant = float(self._tau.mean())
            self._scale_variance = leakage.variance + (self._settings.gain_deviation * self.force) ** 2
        elif any_true(self._was_touched):
            leakage.end_touch()
            self._scale_variance[:] = 0.0
        self._was_touched[:] = touched

    @property
    def _leaked(self) -> Array:
        """Accumulated leakage of each taxel's charge, as a force, up to a constant [N]."""
        leaked: Array = self.force - self.residual_charge + self._thermal.rise * self._per_kelvin
        return leaked

    def _start(self, charge: Array) -> None:
        """Start with a scan that has no predecessor."""
        self._inverse.start(charge)
        remaining = np.where(self.offset_known, self._inverse.signal - self._drift.offset, 0.0)
        self._lower_bound.start(np.where(self.ignored, 0.0, self.force), np.where(self.ignored, 0.0, remaining))
        self.force[:] = np.maximum(remaining, 0.0)
        self._drift.reset_force_to_signal()
        self._started = True
        self._rest.start(self._inverse.signal - self._thermal.residual_signal)
        self._restart(~self.offset_known)
        self._start_block()

    def _start_block(self) -> None:
        self._inverse.invalidate_offset()
        self._sum[:] = self._jumped[:] = 0.0
        if self._corrector.due:
            self._corrector.begin_block(self._leaked)
        self._scans = 0
        self._elapsed = self._elapsed_square = 0.0

    def _shift_baseline(self, change: Array) -> None:
        """Add a correction to the force [N]."""
        self.force += change
        self._drift.record_correction(change)

    def _predict(self) -> None:
        """Propagate baseline and offset over the block."""
        self._drift.predict(self._elapsed, self._elapsed_square)
        deviation = self._thermal.close_block(self._elapsed, self._tau, self._threshold, any_true(self._was_touched))
        if deviation:
            self._drift.variance[:] = (np.sqrt(self._drift.variance) + deviation) ** 2

    def _correct(self, where: Mask, mean: Array, expected: Array) -> None:
        """Update force and offset by the mean of a block in which the force was zero.

        The baseline's rate is limited where the force is well known, so that a slow press is not absorbed as drift.
        """
        limit = self._slew * self._elapsed + 3.0 * np.sqrt(self._noise_variance / self._scans)
        limit += self._settings.gate * self._thermal.mismatch_deviation
        correction = self._drift.gain(expected) * mean
        limited = self.offset_known & (correction > limit) & (expected < self._large_variance)
        self._drift.update(where & ~limited, mean, expected)
        self._shift_baseline(-np.where(where, np.where(limited, limit, correction), 0.0))

    def _restart(self, where: Mask) -> None:
        """Restart the masked taxels: no force, and the signal is offset, or charge left by an earlier force.

        After each rejection the prior deviation of that charge is larger.
        """
        noise = self._noise_variance
        new, known = where & ~self.offset_known, where & self.offset_known
        self._inverse.invalidate_offset()
        self.force[where] = 0.0
        # The offset has the noise of the signal that it is set to; so has the force, with the opposite sign.
        prior = noise[new] + self._prior_deviation[new] ** 2
        offset = (self._inverse.signal - self._thermal.residual_signal)[new]
        self._drift.restart(new, offset, prior, noise[new], -noise[new])
        # Keeping the offset is no worse than taking the signal, which may be leaking.
        self._prior_deviation[known] = self._prior
        least = np.full(np.count_nonzero(known), (RESTART_DEVIATION * self._threshold) ** 2)
        self._drift.restart(known, self._drift.offset[known], least, noise[known], np.zeros(len(least)))
        self._leakage.begin_touch(where, self._leaked)
        self._agreed[where] = 0.0
        self._negative.reset(where)
        self.offset_known[where] = False
