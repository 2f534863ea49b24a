"""What is known of all that the taxels share, as a Kalman filter: the film's warmth, and the mean of the offsets.

The taxels together tell the film's temperature far better than the chip's sensors, which are rounded, while nothing
touches. But a film that wanders reads like an offset, too, and an offset taken from it lets a held force drift. With E
the force that the mean offset has brought in, e_k the errors of the parts of that mean (zero_filter.py), c, r and w the
temperature of the chip [K], its slope [K/s] and the temperature of the film [K], a time T brings

    E <- E - (T/tau)*sum(m_k*e_k) + white noise,    e_k <- a_k*e_k + noise
    c <- c + r*T + wander of variance q*T,    w <- w + (1 - exp(-T/lag))*(c - w)

and all forces are wrong by E + p*(w - W), with p [N/K] the signal for temperature and W [K] the warmth that was taken
off them. At rest the mean force of the taxels over a block measures that, half a block ago; the sensors tell c all the
time, to within their rounding. How fast the film wanders is learnt at rest as well (`Wander`).
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.thermal import RESOLUTION, USUAL_INTERVAL
from posfet_model.zero_filter import BLOCKS, FAST, MEMORIES, PRESSING, fade

Array: TypeAlias = NDArray[np.float64]

FORCE: Final = 0
OFFSETS: Final = slice(1, 1 + len(MEMORIES))
CHIP: Final = 1 + len(MEMORIES)
FILM: Final = CHIP + 1
SLOPE: Final = FILM + 1
SIZE: Final = SLOPE + 1
"""The state."""

ROUNDING: Final = RESOLUTION**2 / 12.0
"""Variance that this gives to one sensor [K2]."""

TOUCHED_WANDER: Final = 2e-3
"""And at least while something touches, which may warm the chip [K/sqrt(s)], assumed."""

TOUCHED_SLOPE: Final = 1 / 60
"""Standard deviation of the rate at which it does so evenly [K/s], assumed."""

SLOPE_MEMORY: Final = 20.0
"""And for how long [s], assumed."""


class SharedZero:
    """The error that all taxels share, block by block."""

    def __init__(
        self,
        time_constant: float,
        lag: float,
        newton_per_kelvin: float,
        flicker: float,
        first: float,
        least_wander: float,
    ) -> None:
        """Take the time constants of leak and film [s], p [N/K], and the wander there is at least [K/sqrt(s)].

        flicker [N2] is the density of one taxel's 1/f noise at 1 Hz times 1 Hz, first [N] what an earlier force may
        have left at the start.
        """
        self._tau, self._lag, self._per_kelvin = time_constant, lag, newton_per_kelvin
        self._first = first
        self._decade = flicker * math.log(10.0)
        self.wander = Wander(lag, newton_per_kelvin, least_wander)
        self._state = np.zeros(SIZE)
        self._covariance = np.zeros((SIZE, SIZE))
        self._covariance[1, 1] = self._first**2
        self._covariance[CHIP:SLOPE, CHIP:SLOPE] = ROUNDING  # both are followed from a reading that is rounded
        self._shift = 0.0  # sum of the corrections by E, less what the offsets took off [N]
        self.following = False
        """Whether the film is just followed."""
        self._touched = False
        self._time = 0.0
        self._believed = least_wander**2  # the greatest density of the wander that was allowed for [K2/s]
        self._past_state = np.zeros((BLOCKS, SIZE))
        self._past_covariance = np.zeros((BLOCKS, SIZE, SIZE))
        self._past_rest = np.zeros((BLOCKS, 3))  # time [s], shift [N], and whether the forces were above zero
        self._newest = self._filled = 0

    @property
    def offset(self) -> float:
        """What has to be added to all offsets [N]."""
        return -float(self._state[OFFSETS].sum())

    @property
    def offset_variance(self) -> float:
        """Its variance [N2]."""
        return float(self._covariance[OFFSETS, OFFSETS].sum())

    @property
    def variance(self) -> float:
        """Variance [N2] of the error that all forces share."""
        shown = self._shown(0.0)
        return float(shown @ self._covariance @ shown)

    @property
    def offset_drift(self) -> float:
        """The part of it that the offsets have brought in [N2]."""
        return float(self._covariance[FORCE, FORCE])

    def grow(self, duration: float, squares: float, white: float, taxels: int, touched: bool) -> None:
        """Pass a time [s].

        squares [s2] is the sum of the squares of its steps, white [N2] the variance of a reading of one of `taxels`.
        """
        self._time += duration
        noise = (white * squares + 2.0 * self._decade * FAST * duration) / self._tau**2
        self._pass(duration, noise / taxels, self._decade / taxels, touched)

    def feel(self, chip: float, age: float, sensors: int, duration: float) -> None:
        """Learn from so many sensors where the chip's temperature was [K] some time [s] before a block's end.

        The block lasts for `duration` [s].
        """
        self.following = False
        seen = np.zeros(SIZE)
        seen[CHIP], seen[SLOPE] = 1.0, -age
        surprise = chip - float(seen @ self._state)
        alike = USUAL_INTERVAL
        if abs(surprise) > RESOLUTION:
            self._covariance[CHIP, CHIP] += surprise * surprise  # no rounding does that: it has warmed or cooled
        elif not self._touched:
            # Readings are rounded alike until the chip has wandered on by a good part of a step.
            alike = max(alike, RESOLUTION**2 / (math.pi**2 * self.wander.density))
        self._learn(seen, surprise, ROUNDING / sensors * max(alike, duration) / duration)

    def follow(self, chip: float, slope: float, warmth: float, variance: float) -> None:
        """Take chip, its slope and film for where they are followed to [K, K/s, K], with the variance [K2] of the film.

        For a chip that does more than wander. What was not known of the film when it began is an error of the forces.
        """
        if not self.following:
            self.following = True
            self._filled = 0
            change = np.eye(SIZE)
            change[FORCE, FILM] = self._per_kelvin
            self._covariance[:] = change @ self._covariance @ change.T
        self._state[CHIP:] = chip, warmth, slope
        self._covariance[CHIP:] = self._covariance[:, CHIP:] = 0.0
        self._covariance[CHIP, CHIP] = self._covariance[FILM, FILM] = variance
        self._covariance[SLOPE, SLOPE] = TOUCHED_SLOPE**2

    def shows(self, warmth: float, duration: float) -> float:
        """Return what the mean force over the last `duration` [s] has to show at rest [N].

        warmth [K] was taken off it, on the mean.
        """
        shown = self._shown(duration)[CHIP:]
        return float(self._state[FORCE]) + float(shown @ self._state[CHIP:]) - self._per_kelvin * warmth

    def expect(self, duration: float) -> float:
        """Return the variance [N2] that the error has in the mean force over the last `duration` [s]."""
        shown = self._shown(duration)
        return float(shown @ self._covariance @ shown)

    def correct(self, surprise: float, duration: float, variance: float) -> None:
        """Learn from the mean force [N] over the last `duration` [s], less what was expected, with its variance."""
        self._learn(self._shown(duration), surprise, variance)

    def settle(self, warmth: float) -> tuple[float, float]:
        """Return E [N] and by how much the film is warmer than the `warmth` [K] that was taken off, to be taken off."""
        force, warmer = float(self._state[FORCE]), float(self._state[FILM]) - warmth
        self._state[FORCE] = 0.0
        self._shift -= force
        return force, warmer

    def watch(self, mean: float, duration: float, noise: float) -> None:
        """Learn how fast the film wanders: see `Wander.take`."""
        self.wander.take(mean, duration, noise)
        density = self.wander.density
        if self.wander.new and density > self._believed:
            # A film that wandered before the start, too, left charge that was taken for an offset.
            self._covariance[1, 1] += (density - self._believed) * self._per_kelvin**2 * self._tau / 2.0
            self._believed = density

    def move(self, force: float) -> None:
        """Take note of a force that was taken off all of them without learning from it [N]."""
        self._shift -= force

    @property
    def shift(self) -> float:
        """What corrections by E added to the forces, less what the offsets took off them [N]."""
        return self._shift

    def shake(self, force: float) -> None:
        """Take note that the film warmed or cooled by about as much as makes this force [N]."""
        self._covariance[CHIP:SLOPE, CHIP:SLOPE] += (force / self._per_kelvin) ** 2

    def warm(self, warmer: float) -> None:
        """Take note that the film was found warmer by this [K], as far as can be told."""
        self._state[FILM] += warmer
        self._covariance[FILM, FILM] += warmer * warmer

    def begin(self, left: float) -> None:
        """Take all forces for known, and the offsets for taken from signals in which that many N may be left."""
        self._state[OFFSETS] = 0.0
        self._covariance[OFFSETS] = self._covariance[:, OFFSETS] = 0.0
        self._covariance[1, 1] = left**2
        self._know_force(0.0)

    def lose_force(self) -> None:
        """Take all forces for what the signals show above the offsets."""
        self._know_force(-1.0)

    def keep(self, mean: float, noise: float) -> None:
        """Remember what is known after a block at rest with this mean force [N], whose variance by itself is noise."""
        index = self._newest = (self._newest + 1) % BLOCKS
        self._past_state[index], self._past_covariance[index] = self._state, self._covariance
        self._past_rest[index] = self._time, self._shift, mean > PRESSING * math.sqrt(noise)
        self._filled = min(self._filled + 1, BLOCKS)

    def undo(self) -> float:
        """Go back to before a touch began that is noticed now; return what that adds to all forces [N].

        As `ZeroFilter.undo`.
        """
        self.wander.forget()
        if not self._filled:
            return 0.0
        age = 0
        while age < self._filled - 1 and self._past_rest[(self._newest - age) % BLOCKS, 2]:
            age += 1
        index = (self._newest - min(age + 1, self._filled - 1)) % BLOCKS
        self._state[:], self._covariance[:] = self._past_state[index], self._past_covariance[index]
        time, shift, _ = self._past_rest[index].tolist()
        back = float(shift) - self._shift
        self._shift = float(shift)
        self._touched = False
        if self._time > time:
            self._pass(self._time - time, 0.0, 0.0, True)
        self._filled = 0
        return back

    def _know_force(self, offsets: float) -> None:
        """Take the forces for wrong by so many times the error of the offsets, and by nothing else."""
        change = np.eye(SIZE)
        change[FORCE] = 0.0
        change[FORCE, OFFSETS] = offsets
        change[FORCE, FILM] = -self._per_kelvin
        self._state[FORCE] = 0.0
        self._covariance[:] = change @ self._covariance @ change.T
        self._filled = 0
        self.wander.forget()

    def _pass(self, duration: float, white: float, decade: float, touched: bool) -> None:
        kept, mean = fade(duration)
        wander = max(self.wander.density, TOUCHED_WANDER**2 if touched else 0.0)
        follows = -math.expm1(-duration / self._lag) if self._lag > 0.0 else 1.0
        passed = np.eye(SIZE)
        passed[FORCE, OFFSETS] = -mean[:, 0] * (duration / self._tau)
        passed[OFFSETS, OFFSETS] = np.diag(kept[:, 0])
        passed[FILM, CHIP], passed[FILM, FILM] = follows, 1.0 - follows
        passed[CHIP, SLOPE] = duration
        passed[SLOPE, SLOPE] = math.exp(-duration / SLOPE_MEMORY)
        state, covariance = self._state, self._covariance
        covariance[CHIP, CHIP] += wander * duration
        self._shift += float(mean[:, 0] @ state[OFFSETS]) * (duration / self._tau)
        force = state[FORCE]
        state = passed @ state
        state[FORCE] = force  # what the offsets were taken for is taken off already
        covariance = passed @ covariance @ passed.T
        covariance[FORCE, FORCE] += white
        if touched and not self._touched:
            covariance[SLOPE, SLOPE] += TOUCHED_SLOPE**2
        elif touched:
            covariance[SLOPE, SLOPE] += TOUCHED_SLOPE**2 * (1.0 - passed[SLOPE, SLOPE] ** 2)
        self._touched = touched
        covariance[1, 1] += 2.0 * decade / MEMORIES[0] * duration
        for part in range(1, len(MEMORIES)):
            covariance[1 + part, 1 + part] += decade * (1.0 - kept[part, 0] ** 2)
        self._state[:], self._covariance[:] = state, covariance

    def _shown(self, duration: float) -> Array:
        """Return how the state shows in the mean force over the last `duration` [s]; 0: in the force now."""
        shown = np.zeros(SIZE)
        shown[FORCE] = 1.0
        shown[OFFSETS] = 0.5 * duration / self._tau
        back = min(math.expm1(0.5 * duration / self._lag), 1.0) if self._lag > 0.0 else 0.0
        shown[CHIP], shown[FILM] = -back * self._per_kelvin, (1.0 + back) * self._per_kelvin
        return shown

    def _learn(self, seen: Array, surprise: float, variance: float) -> None:
        covered = self._covariance @ seen
        gain = covered / (seen @ covered + variance)
        self._state += gain * surprise
        self._covariance -= np.outer(gain, covered)


SPAN: Final = 0.1
"""Time over which the wander is measured [s]."""

WORTH: Final = 500
"""Blocks at rest that count for what is known of it: 10 s."""

NEW: Final = 60
"""Blocks until what was assumed at first does not matter any more."""

FIRST_WORTH: Final = 1.0
"""Blocks at rest that what is assumed at first is worth."""


class Wander:
    """How fast the film wanders, from second differences of what all taxels show.

    An offset and an even warming do not count in them. They are taken late, so that a touch which is not noticed yet
    does not count either.
    """

    def __init__(self, lag: float, newton_per_kelvin: float, least: float) -> None:
        """Take the film's lag [s], p [N/K], and the wander there is at least [K/sqrt(s)]."""
        self._lag, self._per_kelvin, self._least = lag, newton_per_kelvin, least**2
        self._found = least**2
        self._worth = FIRST_WORTH
        self._means: deque[float] = deque(maxlen=1)

    @property
    def density(self) -> float:
        """Variance of the wander in a second [K2/s]."""
        return max(self._found, self._least)

    @property
    def new(self) -> bool:
        """Whether it was measured over no more than a second or so."""
        return self._worth < NEW

    def forget(self) -> None:
        """Forget what was seen and is not counted yet: something touches."""
        self._means.clear()

    def take(self, mean: float, duration: float, noise: float) -> None:
        """Take the mean of what all taxels show [N] over a block of `duration` [s], and the variance of its noise."""
        blocks = max(1, round(SPAN / duration))
        if self._means.maxlen != 2 * blocks + 1 + BLOCKS:
            self._means = deque(maxlen=2 * blocks + 1 + BLOCKS)
        self._means.append(mean)
        if len(self._means) < 2 * blocks + 1 + BLOCKS:
            return
        means, span = self._means, blocks * duration
        change = means[0] - 2.0 * means[blocks] + means[2 * blocks]
        gathers = (4.0 * self._variance(span) - self._variance(2.0 * span)) * self._per_kelvin**2
        found = (change * change - 6.0 * noise) / gathers if gathers > 0.0 else 0.0
        self._worth = min(self._worth + 1.0, WORTH)
        self._found += (found - self._found) / self._worth

    def _variance(self, time: float) -> float:
        """Return the variance [s] of what a film gathers in a time [s] when its chip gathers 1/s."""
        if self._lag <= 0.0:
            return time
        return time + self._lag * math.expm1(-time / self._lag)
