"""The offset that all taxels share, told apart from the warmth of a film that wanders.

The mean signal of untouched taxels is their mean offset o and the charge y that the film's temperature left. That
charge leaks, but while the temperature wanders there is always some, and it looks like an offset for seconds. A held
force would drift by it: an error e of the offset makes e*t/tau. The chip's sensors tell how far the film wandered, so
what all taxels showed in the same time tells the offset. With the temperatures w of the film [K] and c of the chip [K],
its slope r [K/s], and l, which the offset has leaked since a touch began [N], a time T brings

    c <- c + r*T + wander of variance q*T,    w <- w + (1 - exp(-T/lag))*(c - w) + its share of the wander,
    y <- a*y + p*m*dw at rest, y + p*dw under a touch,    l <- l + o*T/tau under a touch, p the signal per kelvin [N/K].

At rest the mean signal shows o + y, and the sensors show c. Under a touch the sensors alone go on to tell, and all
forces are wrong by o + l + y. How fast the temperature wanders is not known: a Kalman filter runs for each q of some,
and counts by the likelihood of what it saw (Magill 1965, IEEE Trans. Automatic Control 10(4), 434-439).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array

WANDERS: Final[Array] = np.array([2e-4 * 2.0**index for index in range(6)])
"""The q that are tried, as sqrt(q) [K/sqrt(s)]. The first is taken for rest."""

CALM: Final = 0.1
"""The film is found to wander when rest is no more likely than this [1]."""

SURE: Final = 0.99
"""It surely rests when that is more likely than this [1]."""

FOUND: Final = 0.4
"""For so long nothing touched until that is said [s]."""

DOUBTED: Final = 2.0
"""ln of by how much likelier rest is than each other q, before anything is seen [1], assumed."""

REMEMBERED: Final = 20.0
"""Time over which likelihoods fade [s]."""

RESOLUTION: Final = 1 / 256
"""Of the chip's sensors [K] (docs/protocol.md)."""

INTERVAL: Final = 0.1
"""From one reading of the sensors to the next [s]."""

SLOPE: Final = 1 / 60
"""Standard deviation of the slope with which a touch warms or cools the chip [K/s], assumed."""

UNKNOWN: Final = 1.0
"""Standard deviation of an offset [N], and of what temperature is called zero [K], before anything is seen."""

JUMP: Final = 6.0
"""A signal so many standard deviations from where it was expected has another cause [1]."""

TOLD_JUMP: Final = 4.0
"""The same for the chip's sensors: so far apart the film never is from what they tell [1]."""

LEAKS: Final = 10.0
"""For so many time constants of the leak what jumped is still in the signals [1]."""

PRESSING: Final = 1.5
"""A signal so many standard deviations above where it was expected may be the beginning of a touch [1]."""

BLOCKS: Final = 12
"""Blocks that are remembered."""

OFFSET, LEAKED, CHARGE, FILM, CHIP, RATE = range(6)
_WRONG: Final = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Seen:
    """What the observer finds at the end of a block."""

    signal: float
    """Mean of the working taxels' signals over the block [N]."""
    noise: float
    """Variance of this mean [N2]."""
    left: float
    """What a touch before may have left in them on the mean [N]."""
    force: float
    """Mean of their forces as they are followed [N]."""
    offset: float
    """Mean of the offsets that were taken off them [N]."""
    warmth: float
    """By how much the film warmed since the start, as it is followed by the sensors [K]."""
    reading: float
    """Chip temperature since the start as its sensors last told it [K]; NaN: none is known."""
    age: float
    """For how long they tell that [s]."""


@dataclass(frozen=True)
class Correction:
    """What to do to all taxels."""

    offset: float
    """To be the mean of all offsets [N]."""
    force: float
    """To be added to the forces [N]."""
    warmer: float
    """By how much the film is warmer than it was followed [K], to be taken off them."""
    begins: bool = False
    """Whether the film was not found to wander until now: what each taxel learnt of its offset is wrong."""
    charge: float = 0.0
    """What the film has left in the signals, on the mean [N]."""
    charge_variance: float = 0.0
    """Variance of what it leaves there while it wanders [N2]."""


@dataclass(frozen=True)
class Touch:
    """What to do to the taxels when something begins to touch, by what was known some blocks ago, latest first."""

    offset: float
    """As in `Correction`."""
    force: Array
    """The same for those whose zero was last corrected at the end of that block, shape [blocks]."""
    warmer: Array
    """The same."""


@dataclass(frozen=True)
class _Past:
    slot: int
    time: float
    left: float
    force: float
    offset: float
    warmth: float
    film: float
    pressing: bool


class SharedOffset:
    """Tells offset and warmth apart, block by block; helps only where the film is found to wander."""

    def __init__(self, time_constant: float, lag: float, newton_per_kelvin: float, flicker: float) -> None:
        """Take the time constants of the leak and of the film's lag [s], p [N/K], and the offset's wander [N2/s]."""
        self.time_constant = time_constant
        """Of the leak [s]; to be written to."""
        self._lag, self._per_kelvin, self._flicker = lag, newton_per_kelvin, flicker
        self._density: Array = WANDERS**2
        self._alike = RESOLUTION**2 / (15.0 * self._density)  # for how long a rounding stays the same [s]
        self.variance = 0.0
        """Of the error that all forces share since a touch began [N2]."""
        self.holding = False
        """Whether `hold` is to be called: a touch began while the film was found to wander."""
        self._states, self._weights = np.zeros((BLOCKS, len(WANDERS), 6)), np.zeros((BLOCKS, len(WANDERS)))
        self._covariances = np.zeros((BLOCKS, len(WANDERS), 6, 6))
        self._slot = 0
        self._new = False
        self.wanders = self.rests = False
        """Whether the film is found to wander, and whether it surely does not."""
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        if self._new:
            return
        self._new = True
        self._likelihood = np.full(len(WANDERS), -DOUBTED)
        self._likelihood[0] = 0.0
        self._past: list[_Past] = []
        self._time = self._rested = 0.0
        self.wanders = self.rests = False
        self._told = math.inf  # age of the reading that was taken last [s]
        self.holding = False
        self.variance = 0.0
        self._state = np.zeros((len(WANDERS), 6))
        self._covariance = np.zeros((len(WANDERS), 6, 6))
        self._covariance[:, OFFSET, OFFSET] = self._covariance[:, FILM, FILM] = UNKNOWN**2

    def rest(self, seen: Seen, duration: float, passed: float, known: bool) -> Correction | None:
        """Take what is seen after a block of `duration` [s] in which nothing touched; None: no help.

        passed is the time [s] since the last one was taken. known: the offsets of most taxels are, and so it is sure
        that nothing touches.
        """
        self._known, self._new = known, False
        if self._past:
            self._pass(passed, held=False)
        else:
            self._begin(seen.left)
        self._time += passed
        self._rested += passed
        self._likelihood *= math.exp(-passed / REMEMBERED)
        warms = self._read(seen.reading, seen.age, passed)
        shown = self._shown(duration)
        error, variance = self._learn(shown, seen.signal, seen.noise)
        # Readings do not count: how much a rounding tells depends on the wander that is tried.
        self._likelihood -= 0.5 * (error * error / variance + np.log(variance))
        self._likelihood -= self._likelihood.max()
        jumped = bool((error * error > JUMP**2 * variance).all())
        if warms or jumped:
            self.forget()
            if jumped:
                self._rested = -LEAKS * self.time_constant
            return None
        likely = int(self._likelihood.argmax())
        pressing = float(error[likely]) > PRESSING * math.sqrt(float(variance[likely]))
        weight = self._mixed = self._weight()
        offset, _, charge = self._means()
        film = float(weight @ self._state[:, FILM])
        left = seen.signal - float(weight @ self._state @ shown)
        correction = self._correct(seen, offset, charge, film, left)
        if correction:
            force, used, warmth = left, offset, seen.warmth + correction.warmer
        else:
            force, used, warmth = seen.force, seen.offset, seen.warmth
        slot = self._slot = (self._slot + 1) % BLOCKS
        self._states[slot], self._covariances[slot], self._weights[slot] = self._state, self._covariance, weight
        past = _Past(slot, self._time, left, force, used, warmth, film, pressing)
        before = self._past[1 - BLOCKS :] if correction and not correction.begins else []
        self._past = [*before, past]
        return correction

    def _correct(self, seen: Seen, offset: float, charge: float, film: float, left: float) -> Correction | None:
        """Return what to do at rest; None: the film is not found to wander."""
        calm, before = float(self._mixed[0]), self.wanders
        self.rests = calm > SURE
        self.wanders = self._known and self._rested >= FOUND and calm < (1.0 - CALM if before else CALM)
        if not self.wanders:
            return None
        if not before or not self._past:
            variance = float(self._mixed @ self._charge_variance())
            return Correction(offset, left - seen.force, 0.0, not before, charge, variance)
        last = self._past[-1]
        warmer = film - last.film - (seen.warmth - last.warmth)
        return Correction(offset, left - seen.force + warmer * self._per_kelvin, warmer)

    def touch(self, warmth: float, duration: float) -> Touch:
        """Take note that something touches while the film `wanders`, noticed at the end of a block of `duration` [s].

        warmth [K] is as in `Seen`. What was learnt since it may have begun is undone.
        """
        self._time += duration
        past = self._past
        then = next((one for one in reversed(past) if not one.pressing), past[0])
        self._state, self._covariance = self._states[then.slot].copy(), self._covariances[then.slot].copy()
        self._mixed = self._weights[then.slot].copy()
        self._covariance[:, RATE, RATE] += SLOPE**2
        self._pass(self._time - then.time, held=True)
        self.holding = True
        offset, _, _ = self._last = self._means()
        self._past = []
        self._used, self._warmth = offset, warmth
        self._find_variance()
        film = float(self._mixed @ self._state[:, FILM])
        return Touch(
            offset,
            np.array(
                [
                    one.left - one.force + (one.offset - offset) * (self._time - one.time) / self.time_constant
                    for one in past[::-1]
                ]
            ),
            np.array([film - one.film - (warmth - one.warmth) for one in past[::-1]]),
        )

    def hold(self, warmth: float, reading: float, age: float, duration: float) -> Correction:
        """Take warmth, reading and age, as in `Seen`, after a block of `duration` [s] under a touch.

        When the chip does more than wander this was the last one: `variance` stays.
        """
        self._pass(duration, held=True)
        self._time += duration
        self.holding = not self._read(reading, age, duration)
        offset, leaked, charge = now = self._means()
        before, self._last = self._last, now
        followed, self._warmth = warmth - self._warmth, warmth
        used, self._used = self._used, offset
        self._find_variance()
        return Correction(
            offset,
            used * duration / self.time_constant - (offset - before[0]) - (leaked - before[1]),
            (charge - before[2]) / self._per_kelvin - followed,
        )

    def _begin(self, left: float) -> None:
        """Begin to rest: what the film has left in the signals by now is not known, nor the part `left` of a touch [N].

        What was known of offset and film still is; the film is taken to have wandered for long.
        """
        self.holding = False
        self.variance = 0.0
        state, covariance, p = self._state, self._covariance, self._per_kelvin
        state[:, [LEAKED, CHARGE, RATE]] = 0.0
        state[:, CHIP] = state[:, FILM]
        film: Array = covariance[:, FILM, FILM].copy()
        for index in (LEAKED, CHARGE, FILM, CHIP, RATE):
            covariance[:, index] = covariance[:, :, index] = 0.0
        together = 0.5 * p * self._density * self._lag / (1.0 + self._lag / self.time_constant)
        covariance[:, CHARGE, CHARGE] = self._charge_variance() + left * left
        covariance[:, CHARGE, CHIP] = covariance[:, CHIP, CHARGE] = together
        covariance[:, FILM, FILM] = covariance[:, FILM, CHIP] = covariance[:, CHIP, FILM] = film
        covariance[:, CHIP, CHIP] = film + 0.5 * self._density * self._lag

    def _charge_variance(self) -> Array:
        """Return the variance [N2] of the charge that a film leaves which has wandered for long."""
        gone = 1.0 + self._lag / self.time_constant
        variance: Array = 0.5 * self._per_kelvin**2 * self._density * self.time_constant / gone
        return variance

    def _read(self, reading: float, age: float, duration: float) -> bool:
        """Learn from the chip's sensors, when they told something or should have.

        Return whether they told more than wander and rounding allow: the chip warms or cools.
        """
        told, self._told = self._told, self._told + duration
        if not math.isfinite(reading) or (age > duration and told < INTERVAL):
            return False
        self._told = 0.0
        age = min(age, duration)
        shown = np.zeros(6)
        shown[CHIP], shown[RATE] = 1.0, -age
        rounding = RESOLUTION**2 / 24.0 * np.maximum(INTERVAL, self._alike) / INTERVAL  # of two sensors
        error, variance = self._learn(shown, reading, rounding + self._density * age)
        return bool((error * error > TOLD_JUMP**2 * variance).all())

    def _shown(self, duration: float) -> Array:
        """Return how the state at the end of a block [s] shows in its mean signal: as it was in its middle."""
        shown = np.zeros(6)
        back = self._per_kelvin * min(0.5 * duration / self._lag, 1.0) if self._lag > 0.0 else 0.0
        shown[OFFSET], shown[CHARGE] = 1.0, 1.0 + 0.5 * duration / self.time_constant
        shown[FILM], shown[CHIP] = back, -back
        return shown

    def _learn(self, shown: Array, value: float, noise: Array | float) -> tuple[Array, Array]:
        """Learn from a measured value; return by how much it surprises each filter, and the variance expected."""
        covered = self._covariance @ shown
        variance = covered @ shown + noise
        error = value - self._state @ shown
        gain = covered / variance[:, None]
        self._state += gain * error[:, None]
        self._covariance -= gain[:, :, None] * covered[:, None, :]
        return error, variance

    def _pass(self, time: float, held: bool) -> None:
        lag, p = self._lag, self._per_kelvin
        kept = math.exp(-time / lag) if lag > 0.0 else 0.0
        follows = 1.0 - kept
        ratio = time / self.time_constant
        left = 1.0 if held else math.exp(-ratio)
        charges = p if held else p * (1.0 - left) / ratio
        passed = np.eye(6)
        passed[CHIP, RATE] = time
        passed[FILM, CHIP], passed[FILM, FILM] = follows, kept
        passed[CHARGE, CHIP], passed[CHARGE, FILM] = charges * follows, -charges * follows
        passed[CHARGE, CHARGE] = left
        passed[LEAKED, OFFSET] = ratio if held else 0.0
        self._state = self._state @ passed.T
        self._covariance = passed @ self._covariance @ passed.T
        both = time - lag * follows
        film = time - 2.0 * lag * follows + 0.5 * lag * (1.0 - kept * kept)
        wander = np.zeros((6, 6))
        wander[CHIP, CHIP], wander[FILM, FILM], wander[CHARGE, CHARGE] = time, film, charges * charges * film
        wander[CHIP, FILM] = wander[FILM, CHIP] = both
        wander[CHIP, CHARGE] = wander[CHARGE, CHIP] = charges * both
        wander[FILM, CHARGE] = wander[CHARGE, FILM] = charges * film
        self._covariance += self._density[:, None, None] * wander
        self._covariance[:, OFFSET, OFFSET] += self._flicker * time

    def _weight(self) -> Array:
        weight = np.exp(self._likelihood - self._likelihood.max())
        normal: Array = weight / weight.sum()
        return normal

    def _means(self) -> tuple[float, float, float]:
        """Return offset, what it has leaked, and the film's charge [N], by all filters."""
        offset, leaked, charge = (self._mixed @ self._state[:, :FILM]).tolist()
        return offset, leaked, charge

    def _find_variance(self) -> None:
        wrong = self._state @ _WRONG
        spread = wrong - self._mixed @ wrong
        self.variance = float(self._mixed @ (self._covariance @ _WRONG @ _WRONG + spread * spread))
