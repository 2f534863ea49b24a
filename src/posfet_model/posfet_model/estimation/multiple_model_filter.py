# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Multiple-model Kalman filter that separates the common offset from a random walk of the film temperature.

The mean signal of untouched taxels is their mean offset o and the pyroelectric charge y. That charge leaks, but while
the temperature is a random walk there is always some, and it looks like an offset for seconds. A held force would
drift by it: an error e of the offset makes e*t/tau. The chip sensors measure the random walk, so the common-mode signal
over the same time gives the offset. With the temperatures w of the film [K] and c of the chip [K], its slope r [K/s],
and l, the leakage of the offset since a touch began [N], a time T brings

    c <- c + r*T + random walk of variance q*T,    w <- w + (1 - exp(-T/lag))*(c - w) + its share of the random walk,
    y <- a*y + p*m*dw at rest, y + p*dw under a touch,    l <- l + o*T/tau under a touch, p the signal per kelvin [N/K].

At rest the mean signal measures o + y, and the sensors measure c. Under a touch only the sensors measure, and all
forces have the error o + l + y. The intensity q of the random walk is unknown: a Kalman filter runs for each of several
q, weighted by the likelihood of its measurements.

References
----------
D. T. Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE Trans. Automatic Control 10(4),
434-439, 1965.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array

INTENSITIES: Final[Array] = np.array([2e-4 * 2.0**index for index in range(6)])
"""The q of the filters, as sqrt(q) [K/sqrt(s)]. The first one represents rest."""

LIKELY_REST: Final = 0.1
"""A random walk is found when the probability of rest is below this [1]."""

SURE_REST: Final = 0.99
"""The film is at rest when the probability of rest is above this [1]."""

LEAST_REST_TIME: Final = 0.4
"""Time without touch after which a random walk may be found [s]."""

PRIOR: Final = 2.0
"""ln of the prior likelihood ratio of rest to each other q [1], assumed."""

LIKELIHOOD_TIME: Final = 20.0
"""Time constant of the exponential forgetting of likelihoods [s]."""

RESOLUTION: Final = 1 / 256
"""Resolution of the chip sensors [K] (docs/protocol.md)."""

INTERVAL: Final = 0.1
"""Interval between two readings of the sensors [s]."""

SLOPE: Final = 1 / 60
"""Standard deviation of the slope of the chip temperature under a touch [K/s], assumed."""

UNKNOWN: Final = 1.0
"""Prior standard deviation of the offset [N] and of the film temperature [K]."""

SIGNAL_OUTLIER: Final = 6.0
"""Standard deviations of the innovation beyond which a signal has another cause [1]."""

SENSOR_OUTLIER: Final = 4.0
"""The same for the chip sensors: a larger innovation is no random walk [1]."""

DISTURBANCE_TIME: Final = 10.0
"""Time for which a jump stays in the signals, in time constants of the leakage [1]."""

PRESSING: Final = 1.5
"""Standard deviations of the innovation above which a signal may be the onset of a touch [1]."""

BLOCKS: Final = 12
"""Number of blocks whose states are kept."""

OFFSET, LEAKED, CHARGE, FILM, CHIP, RATE = range(6)
_FORCE_ERROR: Final = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class BlockObservation:
    """Measurements at the end of a block without touch."""

    signal: float
    """Mean of the usable taxels' signals over the block [N]."""
    noise: float
    """Variance of this mean [N2]."""
    residual: float
    """Mean charge that an earlier touch may have left in the signals [N]."""
    force: float
    """Mean of the estimated forces [N]."""
    offset: float
    """Mean of the estimated offsets that were compensated [N]."""
    film_rise: float
    """Film temperature rise since the start, estimated from the sensors [K]."""
    reading: float
    """Chip temperature since the start in the last reading [K]; NaN: no sensor reports."""
    age: float
    """Age of that reading [s]."""


@dataclass(frozen=True)
class Correction:
    """Correction of all taxels."""

    offset: float
    """Mean of all offsets [N]."""
    force: float
    """Correction to be added to the forces [N]."""
    rise: float
    """Film temperature rise to be compensated in the forces [K]."""
    begins: bool = False
    """Whether the random walk was found in this block: previous estimates of the offsets are wrong."""
    charge: float = 0.0
    """Mean pyroelectric charge in the signals [N]."""
    charge_variance: float = 0.0
    """Variance of the pyroelectric charge under the random walk [N2]."""


@dataclass(frozen=True)
class TouchCorrection:
    """Correction of the taxels when a touch begins, from the states of earlier blocks, latest first."""

    offset: float
    """Mean of all offsets [N]."""
    force: Array
    """Correction [N] for taxels whose baseline was last corrected at the end of that block, shape [blocks]."""
    rise: Array
    """Film temperature rise to be compensated [K] for the same, shape [blocks]."""


@dataclass(frozen=True)
class _Past:
    slot: int
    time: float
    residual: float
    force: float
    offset: float
    film_rise: float
    film: float
    pressing: bool


class CommonOffsetFilter:
    """Separates offset and pyroelectric charge, block by block; effective only where a random walk is found.

    State variables of each filter: offset [N], its leakage since the touch began [N], pyroelectric charge [N], film
    and chip temperatures [K], slope of the chip temperature [K/s]; their covariance; log-likelihoods of the filters.

    Parameters
    ----------
    time_constant : float
        Leakage time constant tau [s].
    lag : float
        Time constant of the film's lag [s].
    newton_per_kelvin : float
        p, pyroelectric signal [N/K].
    random_walk : float
        Variance per time of the offset's random walk [N2/s].
    """

    def __init__(self, time_constant: float, lag: float, newton_per_kelvin: float, random_walk: float) -> None:
        self.time_constant = time_constant
        """Leakage time constant [s]; written by others."""
        self._lag, self._per_kelvin, self._random_walk = lag, newton_per_kelvin, random_walk
        self._density: Array = INTENSITIES**2
        self._rounding_time = RESOLUTION**2 / (15.0 * self._density)  # correlation time of the rounding error [s]
        self.variance = 0.0
        """Variance of the error common to all forces since a touch began [N2]."""
        self.holding = False
        """Whether `update_touched` is required: a touch began while a random walk was found."""
        self._states, self._weights = np.zeros((BLOCKS, len(INTENSITIES), 6)), np.zeros((BLOCKS, len(INTENSITIES)))
        self._covariances = np.zeros((BLOCKS, len(INTENSITIES), 6, 6))
        self._slot = 0
        self._new = False
        self.random_walk_found = self.at_rest = False
        """Whether the film temperature is a random walk, and whether it surely is at rest."""
        self.reset()

    def reset(self) -> None:
        """Reset all filters to their prior."""
        if self._new:
            return
        self._new = True
        self._likelihood = np.full(len(INTENSITIES), -PRIOR)
        self._likelihood[0] = 0.0
        self._past: list[_Past] = []
        self._time = self._rested = 0.0
        self.random_walk_found = self.at_rest = False
        self._reading_age = math.inf  # age of the last reading that was processed [s]
        self.holding = False
        self.variance = 0.0
        self._state = np.zeros((len(INTENSITIES), 6))
        self._covariance = np.zeros((len(INTENSITIES), 6, 6))
        self._covariance[:, OFFSET, OFFSET] = self._covariance[:, FILM, FILM] = UNKNOWN**2

    def update_at_rest(self, seen: BlockObservation, duration: float, passed: float, known: bool) -> Correction | None:
        """Process a block without touch; return the correction of all taxels.

        Parameters
        ----------
        seen : BlockObservation
            Measurements at the end of the block.
        duration : float
            Duration of the block [s].
        passed : float
            Time since the last block that was processed [s].
        known : bool
            Whether the offsets of most taxels are known, so that surely nothing touches.

        Returns
        -------
        Correction or None
            The correction; None: no random walk is found.
        """
        self._known, self._new = known, False
        if self._past:
            self._propagate(passed, held=False)
        else:
            self._start(seen.residual)
        self._time += passed
        self._rested += passed
        self._likelihood *= math.exp(-passed / LIKELIHOOD_TIME)
        ramps = self._read(seen.reading, seen.age, passed)
        observation = self._signal_model(duration)
        error, variance = self._update(observation, seen.signal, seen.noise)
        if not bool((variance > 0.0).all()):  # rounding, where the sensor's values differ by too many powers of ten
            self.reset()
            return None
        # Readings do not count: the information in a rounded value depends on the intensity of the random walk.
        self._likelihood -= 0.5 * (error * error / variance + np.log(variance))
        self._likelihood -= self._likelihood.max()
        jumped = bool((error * error > SIGNAL_OUTLIER**2 * variance).all())
        if ramps or jumped:
            self.reset()
            if jumped:
                self._rested = -DISTURBANCE_TIME * self.time_constant
            return None
        likely = int(self._likelihood.argmax())
        pressing = float(error[likely]) > PRESSING * math.sqrt(float(variance[likely]))
        weight = self._mixed = self._weight()
        offset, _, charge = self._means()
        film = float(weight @ self._state[:, FILM])
        residual = seen.signal - float(weight @ self._state @ observation)
        correction = self._correct(seen, offset, charge, film, residual)
        if correction:
            force, used, film_rise = residual, offset, seen.film_rise + correction.rise
        else:
            force, used, film_rise = seen.force, seen.offset, seen.film_rise
        slot = self._slot = (self._slot + 1) % BLOCKS
        self._states[slot], self._covariances[slot], self._weights[slot] = self._state, self._covariance, weight
        past = _Past(slot, self._time, residual, force, used, film_rise, film, pressing)
        before = self._past[1 - BLOCKS :] if correction and not correction.begins else []
        self._past = [*before, past]
        return correction

    def _correct(
        self, seen: BlockObservation, offset: float, charge: float, film: float, residual: float
    ) -> Correction | None:
        """Return the correction at rest; None: no random walk is found."""
        rest, before = float(self._mixed[0]), self.random_walk_found
        self.at_rest = rest > SURE_REST
        limit = 1.0 - LIKELY_REST if before else LIKELY_REST
        self.random_walk_found = self._known and self._rested >= LEAST_REST_TIME and rest < limit
        if not self.random_walk_found:
            return None
        if not before or not self._past:
            variance = float(self._mixed @ self._charge_variance())
            return Correction(offset, residual - seen.force, 0.0, not before, charge, variance)
        last = self._past[-1]
        rise = film - last.film - (seen.film_rise - last.film_rise)
        return Correction(offset, residual - seen.force + rise * self._per_kelvin, rise)

    def begin_touch(self, film_rise: float, duration: float) -> TouchCorrection:
        """Roll back to the state before a touch, which was detected at the end of a block while `random_walk_found`.

        Parameters
        ----------
        film_rise : float
            Film temperature rise since the start, estimated from the sensors [K].
        duration : float
            Duration of the block [s].

        Returns
        -------
        TouchCorrection
            Correction of the taxels on which the touch begins.
        """
        self._time += duration
        past = self._past
        then = next((one for one in reversed(past) if not one.pressing), past[0])
        self._state, self._covariance = self._states[then.slot].copy(), self._covariances[then.slot].copy()
        self._mixed = self._weights[then.slot].copy()
        self._covariance[:, RATE, RATE] += SLOPE**2
        self._propagate(self._time - then.time, held=True)
        self.holding = True
        offset, _, _ = self._last = self._means()
        self._past = []
        self._used, self._film_rise = offset, film_rise
        self._find_variance()
        film = float(self._mixed @ self._state[:, FILM])
        return TouchCorrection(
            offset,
            np.array(
                [
                    one.residual - one.force + (one.offset - offset) * (self._time - one.time) / self.time_constant
                    for one in past[::-1]
                ]
            ),
            np.array([film - one.film - (film_rise - one.film_rise) for one in past[::-1]]),
        )

    def update_touched(self, film_rise: float, reading: float, age: float, duration: float) -> Correction:
        """Process a block under a touch; the last one when the chip temperature ramps, after which `variance` stays.

        Parameters
        ----------
        film_rise : float
            Film temperature rise since the start, estimated from the sensors [K].
        reading : float
            Chip temperature since the start in the last reading [K]; NaN: no sensor reports.
        age : float
            Age of that reading [s].
        duration : float
            Duration of the block [s].

        Returns
        -------
        Correction
            Correction of all taxels.
        """
        self._propagate(duration, held=True)
        self._time += duration
        self.holding = not self._read(reading, age, duration)
        offset, leaked, charge = now = self._means()
        before, self._last = self._last, now
        estimated, self._film_rise = film_rise - self._film_rise, film_rise
        used, self._used = self._used, offset
        self._find_variance()
        return Correction(
            offset,
            used * duration / self.time_constant - (offset - before[0]) - (leaked - before[1]),
            (charge - before[2]) / self._per_kelvin - estimated,
        )

    def _start(self, residual: float) -> None:
        """Start at rest: the pyroelectric charge is unknown, and so is the charge `residual` left by a touch [N].

        Offset and film temperature stay known; the random walk is assumed to be stationary.
        """
        self.holding = False
        self.variance = 0.0
        state, covariance, p = self._state, self._covariance, self._per_kelvin
        state[:, [LEAKED, CHARGE, RATE]] = 0.0
        state[:, CHIP] = state[:, FILM]
        film: Array = covariance[:, FILM, FILM].copy()
        for index in (LEAKED, CHARGE, FILM, CHIP, RATE):
            covariance[:, index] = covariance[:, :, index] = 0.0
        chip_covariance = 0.5 * p * self._density * self._lag / (1.0 + self._lag / self.time_constant)
        covariance[:, CHARGE, CHARGE] = self._charge_variance() + residual * residual
        covariance[:, CHARGE, CHIP] = covariance[:, CHIP, CHARGE] = chip_covariance
        covariance[:, FILM, FILM] = covariance[:, FILM, CHIP] = covariance[:, CHIP, FILM] = film
        covariance[:, CHIP, CHIP] = film + 0.5 * self._density * self._lag

    def _charge_variance(self) -> Array:
        """Return the stationary variance of the pyroelectric charge under the random walk [N2]."""
        ratio = 1.0 + self._lag / self.time_constant
        variance: Array = 0.5 * self._per_kelvin**2 * self._density * self.time_constant / ratio
        return variance

    def _read(self, reading: float, age: float, duration: float) -> bool:
        """Update by the chip sensors when there is a new reading, or when one was due.

        Return whether the innovation exceeds random walk and rounding: the chip temperature ramps.
        """
        reading_age, self._reading_age = self._reading_age, self._reading_age + duration
        if not math.isfinite(reading) or (age > duration and reading_age < INTERVAL):
            return False
        self._reading_age = 0.0
        age = min(age, duration)
        observation = np.zeros(6)
        observation[CHIP], observation[RATE] = 1.0, -age
        rounding = RESOLUTION**2 / 24.0 * np.maximum(INTERVAL, self._rounding_time) / INTERVAL  # of two sensors
        error, variance = self._update(observation, reading, rounding + self._density * age)
        return bool((error * error > SENSOR_OUTLIER**2 * variance).all())

    def _signal_model(self, duration: float) -> Array:
        """Return the observation vector of a block's mean signal [s]: the state at its end gives that in its middle."""
        observation = np.zeros(6)
        back = self._per_kelvin * min(0.5 * duration / self._lag, 1.0) if self._lag > 0.0 else 0.0
        observation[OFFSET], observation[CHARGE] = 1.0, 1.0 + 0.5 * duration / self.time_constant
        observation[FILM], observation[CHIP] = back, -back
        return observation

    def _update(self, observation: Array, value: float, noise: Array | float) -> tuple[Array, Array]:
        """Update all filters by a measured value; return their innovations and innovation variances."""
        projection = self._covariance @ observation
        variance = projection @ observation + noise
        error = value - self._state @ observation
        gain = projection / variance[:, None]
        self._state += gain * error[:, None]
        self._covariance -= gain[:, :, None] * projection[:, None, :]
        return error, variance

    def _propagate(self, time: float, held: bool) -> None:
        """Propagate all filters by a time [s], `held`: under a touch."""
        lag, p = self._lag, self._per_kelvin
        kept = math.exp(-time / lag) if lag > 0.0 else 0.0
        follows = 1.0 - kept
        ratio = time / self.time_constant
        left = 1.0 if held else math.exp(-ratio)
        charges = p if held else p * (1.0 - left) / ratio
        transition = np.eye(6)
        transition[CHIP, RATE] = time
        transition[FILM, CHIP], transition[FILM, FILM] = follows, kept
        transition[CHARGE, CHIP], transition[CHARGE, FILM] = charges * follows, -charges * follows
        transition[CHARGE, CHARGE] = left
        transition[LEAKED, OFFSET] = ratio if held else 0.0
        self._state = self._state @ transition.T
        self._covariance = transition @ self._covariance @ transition.T
        both = time - lag * follows
        film = time - 2.0 * lag * follows + 0.5 * lag * (1.0 - kept * kept)
        noise = np.zeros((6, 6))
        noise[CHIP, CHIP], noise[FILM, FILM], noise[CHARGE, CHARGE] = time, film, charges * charges * film
        noise[CHIP, FILM] = noise[FILM, CHIP] = both
        noise[CHIP, CHARGE] = noise[CHARGE, CHIP] = charges * both
        noise[FILM, CHARGE] = noise[CHARGE, FILM] = charges * film
        self._covariance += self._density[:, None, None] * noise
        self._covariance[:, OFFSET, OFFSET] += self._random_walk * time

    def _weight(self) -> Array:
        weight = np.exp(self._likelihood - self._likelihood.max())
        normal: Array = weight / weight.sum()
        return normal

    def _means(self) -> tuple[float, float, float]:
        """Return offset, its leakage and the pyroelectric charge [N], weighted over the filters."""
        offset, leaked, charge = (self._mixed @ self._state[:, :FILM]).tolist()
        return offset, leaked, charge

    def _find_variance(self) -> None:
        error = self._state @ _FORCE_ERROR
        spread = error - self._mixed @ error
        self.variance = float(self._mixed @ (self._covariance @ _FORCE_ERROR @ _FORCE_ERROR + spread * spread))
