"""Static force from the leaking signal.

The charge of a held force leaks with the time constant tau. In units of force, x = sigma*A/(-d33), a scan at the end of
a step h tells by how much the source of charge has changed (the inverse of the first-order hold, charge.py):

    dF = (x1 - x0)/m + (h/tau)*(x0 - o) - dTheta*p*A/(-d33),    m = (1 - exp(-h/tau))/(h/tau)

with the offset o that is left of the amplifier's. F is the sum of the dF: it holds as long as the force does. Two
errors add up in it: white noise s per scan to a random walk of variance s^2*(h/tau)^2 per scan, and an error e of the
offset to a ramp -e*t/tau. Where nothing touches, F is its own error: a Kalman filter (zero_filter.py) learns offset and
zero from its mean over blocks of scans there. Elsewhere what is known of both just fades. A wrong tau shows while a
force is held, and when it is let go: leak_watch.py finds the right one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import any_true
from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.common_mode import CommonMode
from posfet_model.estimation.common_mode_correction import Together
from posfet_model.estimation.drift_filter import ZeroFilter
from posfet_model.estimation.film_temperature import FilmTemperature
from posfet_model.estimation.leakage_identification import LeakWatch
from posfet_model.estimation.leakage_inverse import LeakInverse
from posfet_model.estimation.rest_detector import Rest
from posfet_model.estimation.settings import (
    ALIKE,
    DOUBT,
    KNOWN_BEFORE,
    LONG_STEP,
    REFUTED,
    RESTLESS_WORTH,
    RUNAWAY,
    ObserverSettings,
)
from posfet_model.estimation.thermal_uncertainty import Warming
from posfet_model.estimation.validity import BelowZero, LostForce
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms


class ForceObserver:
    """Force [N] of every taxel, with its variance, from charge densities; row by row, shape [rows * cols].

    Call `advance` per scan, and `close_block` whenever `block_due` says so. No force at the start is assumed: a taxel
    that is loaded then reads zero, below zero once the load goes, and soon after that zero again.
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
        s, recorded = self._settings, calibration.residuals is not None
        leak = (s.leak_shared_calibrated, s.leak_own_calibrated) if recorded else (s.leak_shared, s.leak_own)
        self._leaks = LeakWatch(calibration.leak_time_constant, self._noise_variance, *leak)
        self._tau = self._leaks.time_constant
        self._leak = LeakInverse(self._tau, newton_per_charge)
        self._long_step = LONG_STEP * float(self._tau.min())
        self._prior = self._settings.first_deviation / sensor.volts_per_newton
        flicker = (s.flicker / sensor.volts_per_newton) ** 2
        drift = (s.temperature_wander * newton_per_kelvin) ** 2
        self._zeros = ZeroFilter(self._tau, self._noise_variance, flicker, drift)
        self._slew = self._settings.zero_slew * sensor.contact.threshold
        self._doubt = (DOUBT * sensor.contact.threshold) ** 2
        self._negative = sensor.contact.threshold
        self._runaway = RUNAWAY * device.force_max
        self._known_offset = (0.5 * sensor.contact.threshold * self._tau) ** 2
        lag = calibration.thermal_time_constant
        self.film = FilmTemperature(device.thermal_time_constant if lag is None else lag)
        self.common = CommonMode(self.film, newton_per_kelvin, sensor.contact.threshold, noise)
        uneven = s.uneven_calibrated if recorded else s.uneven
        self._warming = Warming(self.film, self.common, self._per_kelvin, uneven, recorded)
        self.force = np.zeros(taxels)
        """Estimated force [N]; meaningful where `settled`. Owned by the observer."""
        self.settled = np.zeros(taxels, np.bool_)
        """Where the offset is known."""
        self.ignored = np.zeros(taxels, np.bool_)
        """Taxels that do not work: `valid` does not wait for them. Set by `ignore`."""
        self.valid = self._any_ignored = False
        """Whether every taxel is settled."""
        self.restarts = 0
        """Taxels that had to start anew because their signal fitted no force."""
        self._rest = Rest(taxels, noise, ALIKE * sensor.contact.threshold, s.settle, float(self._tau.max()))
        self._started, self._recovering = False, 0.0
        self._lost = LostForce(taxels, self._negative, s.recover)
        self._make_state(taxels)
        self._together = Together(self.force, self._zeros, self._leaks, self._warming, sensor.contact.threshold)
        self._start_block()

    def _make_state(self, taxels: int) -> None:
        self._change, self._scale_variance = np.zeros((2, taxels))
        self._prior_deviation = np.full(taxels, self._prior)
        self._was_touched = np.zeros(taxels, np.bool_)
        self._below_zero = BelowZero(taxels, self._settings.steady)
        self._agreed, self._last_mean, self._sum = np.zeros((3, taxels))
        self._jumped = np.zeros(taxels)  # variance of long steps in the block so far

    @property
    def block_due(self) -> bool:
        """Whether `close_block` has to be called before the next scan."""
        return self._elapsed >= self._settings.block

    @property
    def common_variance(self) -> float:
        """Variance [N2] that all taxels share: what is not known of the film's temperature."""
        unknown = self._warming.common_variance
        return max(unknown, self._together.offset.variance) if unknown else unknown

    def variance(self, out: Array) -> Array:
        """Return in `out` the variance of `force` [N2] that each taxel has alone, the common one left out."""
        more = self._warming.uneven_variance
        return np.add(self._zeros.variance, self._noise_variance + more if more else self._noise_variance, out=out)

    def force_variance(self, out: Array) -> Array:
        """Return in `out` the same with what is not known of gain and leak: of a force, not of its zero.

        As of the last block: a touch that began since does not count yet.
        """
        return np.add(self.variance(out), self._scale_variance, out=out)

    @property
    def shared_error(self) -> Array:
        """By how much each force is wrong if the leak that all taxels share is by a standard deviation [N]."""
        return self._leaks.shared_error

    @property
    def block_time(self) -> float:
        """Duration of the block so far [s]."""
        return self._elapsed

    @property
    def block_mean(self) -> Array:
        """Mean of `force` over the block that is due [N], shape [rows * cols]."""
        return self._sum / self._scans

    @property
    def leaking(self) -> Array:
        """Charge left at each gate, as the force that would bring it [N], shape [rows * cols]."""
        return self._leak.signal - self._zeros.offset

    @property
    def change(self) -> Array:
        """By how much each force changed in the last step by what the signals tell [N], shape [rows * cols]."""
        return self._change

    def ignore(self, taxels: Mask) -> None:
        """Take note of which taxels do not work; one that works again finds its zero anew."""
        back = self.ignored & ~taxels
        self.ignored[:] = taxels
        self._any_ignored = bool(taxels.any())
        self._together.use(~taxels)
        if back.any():
            self._restart(back)

    def know_noise(self, variance: Array) -> None:
        """Take the variance of a reading of each taxel [N2], shape [rows * cols]: all alike until told."""
        self._noise_variance[:] = variance
        self._zeros.noise_variance[:] = variance

    def interrupt(self) -> None:
        """Take note that an unknown time passes before the next scan: what the force did in it cannot be known.

        Offsets stay known. The next scan takes as force what charge it finds: that much at least was pressed lately.
        """
        self._started = False
        self.valid = False
        self._recovering = self._settings.resume
        self._leaks.forget()
        self._together.offset.forget()

    def advance(self, charge: Array, temperatures: NDArray[np.float32], step: float) -> None:
        """Take the charge densities [C/m2] of the scan that ends a step [s], and the chip's temperatures [degC]."""
        warmed = self.film.update(temperatures, step)
        if not self._started:
            self._first(charge)
            return
        change, force, total = self._change, self.force, self._sum
        leak = self._leak.advance(charge, self._zeros.offset, step, change)
        if warmed:
            change -= warmed * self._per_kelvin
            self._warming.warmth += warmed
            self._together.followed += warmed
        force += change
        total += force
        self._scans += 1
        self._elapsed += step
        self._elapsed_square += step * step
        if step > self._long_step:
            # A jump at an unknown moment of the step has leaked by an unknown share of h/tau, evenly distributed.
            self._jumped += (change * leak.ratio) ** 2 / 12.0
            self._zeros.variance[:] += (change * leak.ratio) ** 2 / 12.0
            self._leaks.forget()

    def follow_common(self, touched: bool) -> None:
        """Take what the taxels show together as the film's own temperature; `touched`: something touches."""
        if not self.valid or not (touched or self.common.active):
            return
        self._together.follow(self.force[~self.ignored] if self._any_ignored else self.force, touched)

    def tare(self) -> Array:
        """Make zero of what the last block read; return what was added to each force [N], 0 where it is ignored.

        Offsets stay: they are found all the time.
        """
        change = np.where(self.ignored, 0.0, -self._last_mean)
        self._move(change)
        self._zeros.know_force(slice(None), self._noise_variance)
        return change

    def lose(self, saturated: Mask, step: float) -> None:
        """Count as unknown the charge that leaks beyond the end of the range during a step [s] of the masked taxels."""
        lost = np.abs(self._leak.signal[saturated]) * (step / self._tau[saturated])
        variance = self._zeros.variance
        variance[saturated] = (np.sqrt(variance[saturated]) + lost) ** 2

    def close_block(self, touched: Mask) -> None:
        """Correct zero and offset where nothing touched during the block; everywhere else let the covariance grow.

        `touched` masks the taxels in or near a contact at any time of the block. It is not heeded where the offset is
        not known yet: there a force held constant tells the offset just as well.
        """
        s, zeros = self._settings, self._zeros
        mean = self._sum / self._scans
        if self._together.due:
            self._together.look(self._leaked, self._elapsed, self._scans)
        self._together.clear(mean, touched, self.common.told)
        noise = self._noise_variance / self._scans
        self._grow()
        if any_true(self._was_touched):
            self._together.hold(self._elapsed)
        self._follow_touches(touched & self.settled, mean)
        # An error of the film's temperature is the same through the block: the mean does not make it smaller.
        expected = zeros.expect(self._elapsed, noise + self.common_variance)
        agrees = mean * mean <= s.gate * s.gate * (expected + self._warming.film_variance)
        free = ~touched | ~self.settled
        if any_true(where := free & agrees):
            self._correct(where, mean, expected)
        if any_true(where := free & self.settled & ~agrees):
            # Neither a contact nor an error known of: followed slowly.
            low, high = -s.zero_rise * self._negative * self._elapsed, self._slew * self._elapsed
            self._move(-np.where(where, np.clip(mean, low, high), 0.0))
        self._heal(free & self.settled, mean, noise, expected)
        unknown_misled, known_misled = self._together.misled(self._elapsed)
        self.settled &= not known_misled
        failed = ~self.settled & (~agrees | unknown_misled)
        failed |= np.abs(self.force) > self._runaway
        failed |= self._below_zero.lasts >= s.recover
        # While the film is elsewhere than followed, all taxels together can pretend an offset for a while.
        self._agreed += self._elapsed * (1.0 if self.film.quiet else RESTLESS_WORTH)
        if any_true(failed):
            again = failed & ~self.settled
            self._prior_deviation[again] = np.minimum(REFUTED * self._prior_deviation[again], self._runaway)
            self.restarts += int(np.count_nonzero(failed & ~self.ignored))
            self._restart(failed)
        self._settle()
        self._recovering = max(0.0, self._recovering - self._elapsed)
        self._lost.close(mean, self._elapsed)
        sound = self.settled & (self._below_zero.lasts == 0.0) & ~self._lost.mask | self.ignored
        self.valid = self._recovering == 0.0 and not any_true(~sound)
        self._last_mean = mean
        self._together.close(mean, any_true(touched), self._leak.signal, self.settled, self.valid, self._elapsed)
        zeros.keep(mean, noise)
        self._start_block()

    def _heal(self, where: Mask, mean: Array, noise: Array, expected: Array) -> None:
        """Set zeros right that were taken under load: forces below zero cannot be."""
        gate = self._settings.gate
        lowest = np.maximum(self._negative, gate * np.sqrt(expected))
        still = np.abs(mean - self._last_mean) <= gate * np.sqrt(2.0 * noise)
        ripe = self._below_zero.look(where, mean, lowest, still, self._elapsed)
        if any_true(ripe):
            self.force[ripe] -= mean[ripe]
            self._zeros.know_force(ripe, self._noise_variance[ripe])

    def _settle(self) -> None:
        """Believe offsets once the array is at rest."""
        if self.settled.all():
            return
        cold = self._leak.signal - self._warming.left
        at_rest = self._rest.look(cold, self.ignored, self._elapsed, not self.film.quiet)
        if self._rest.moved:
            self._restart(~self.settled)
        elif at_rest:
            lasts = self._agreed >= self._settings.settle
            self.settled |= lasts & (self._zeros.offset_variance <= self._known_offset)

    def _follow_touches(self, touched: Mask, mean: Array) -> None:
        """Put touched taxels back to before what was taken for drift, and learn from touched ones how they leak."""
        leaks, begun = self._leaks, touched & ~self._was_touched
        if any_true(begun):
            back, blocks = self._zeros.undo(begun)
            self.force[begun] += back
            if self.valid and not any_true(self._was_touched):
                self._together.touch(begun, blocks, self._elapsed)
            self._zeros.variance[begun] += self._jumped[begun]
            leaks.begin(begun, self._leaked)
            self._warming.begin(begun)
        if any_true(touched):
            if not self.film.quiet:
                leaks.forget()  # the film's charge leaks, too, and is not known as well as a window needs
            leaks.take(self._elapsed, self._scans, mean, self._leaked, touched & self._was_touched)
            change = leaks.learn(touched, self._warming.told_leak)
            if change is not None:
                self.force += change
                self._leak.forget()
                self._together.offset.time_constant = float(self._tau.mean())
            self._scale_variance = leaks.variance + (self._settings.gain * self.force) ** 2
        elif any_true(self._was_touched):
            leaks.rest()
            self._scale_variance[:] = 0.0
        self._was_touched[:] = touched

    @property
    def _leaked(self) -> Array:
        """What leaked of each taxel's charge so far, as a force [N], but for a constant."""
        leaked: Array = self.force - self.leaking + self._warming.warmth * self._per_kelvin
        return leaked

    def _first(self, charge: Array) -> None:
        """Begin with a scan that has none before it."""
        self._leak.begin(charge)
        left = np.where(self.settled, self._leak.signal - self._zeros.offset, 0.0)
        self._lost.begin(np.where(self.ignored, 0.0, self.force), np.where(self.ignored, 0.0, left))
        self.force[:] = np.maximum(left, 0.0)
        self._zeros.lose_force()
        self._started = True
        self._rest.begin(self._leak.signal - self._warming.left)
        self._restart(~self.settled)
        self._start_block()

    def _start_block(self) -> None:
        self._leak.forget_offset()
        self._sum[:] = self._jumped[:] = 0.0
        if self._together.due:
            self._together.begin_block(self._leaked)
        self._scans = 0
        self._elapsed = self._elapsed_square = 0.0

    def _move(self, change: Array) -> None:
        """Add a correction to the force."""
        self.force += change
        self._zeros.move(change)

    def _grow(self) -> None:
        """Let what is known of the zeros fade over the block."""
        self._zeros.grow(self._elapsed, self._elapsed_square)
        uneven = self._warming.close(self._elapsed, self._tau, self._negative, any_true(self._was_touched))
        if uneven:
            self._zeros.variance[:] = (np.sqrt(self._zeros.variance) + uneven) ** 2

    def _correct(self, where: Mask, mean: Array, expected: Array) -> None:
        """Update force and offset by the mean of a block in which force was zero.

        Where the force is well known the zero moves only slowly, so that a slow press is not eaten.
        """
        limit = self._slew * self._elapsed + 3.0 * np.sqrt(self._noise_variance / self._scans)
        limit += self._settings.gate * self._warming.uneven
        correction = self._zeros.gain(expected) * mean
        limited = self.settled & (correction > limit) & (expected < self._doubt)
        self._zeros.correct(where & ~limited, mean, expected)
        self._move(-np.where(where, np.where(limited, limit, correction), 0.0))

    def _restart(self, where: Mask) -> None:
        """Begin anew with the masked taxels: no force, and all signal an offset, or left of a force before.

        Where that was refuted, more may be left.
        """
        noise = self._noise_variance
        new, known = where & ~self.settled, where & self.settled
        self._leak.forget_offset()
        self.force[where] = 0.0
        # The offset has the noise of the signal it is taken from, which the force has, too, the other way round.
        prior = noise[new] + self._prior_deviation[new] ** 2
        self._zeros.begin(new, (self._leak.signal - self._warming.left)[new], prior, noise[new], -noise[new])
        # No worse than the signal, which may be leaking.
        self._prior_deviation[known] = self._prior
        least = np.full(np.count_nonzero(known), (KNOWN_BEFORE * self._negative) ** 2)
        self._zeros.begin(known, self._zeros.offset[known], least, noise[known], np.zeros(len(least)))
        self._leaks.begin(where, self._leaked)
        self._agreed[where] = 0.0
        self._below_zero.forget(where)
        self.settled[where] = False
