"""What is known of the zeros: the error of each taxel's force and the offset behind it, as a Kalman filter.

With d the error of the force and e_k those of the parts of the amplifier's offset o [N], a time T brings

    d <- d - (T/tau)*sum(m_k*e_k) + white noise + unseen temperature,    m_k = (1 - a_k)*T_k/T
    e_k <- a_k*e_k + noise of variance K^2*ln(10)*(1 - a_k^2),           a_k = exp(-T/T_k)

as 1/f noise of density K^2/f is the sum of first-order Markov processes, one per decade of the memory T_k, each of
variance K^2*ln(10). There is one part for each memory that matters to a held force, and one that wanders for ever.
Where nothing touches, the mean of the force over a block is a measurement of d half a block ago: d + T/(2*tau)*sum(e_k)
and white noise. While something touches nothing is measured, and each part goes back to 0 as its memory fades.

A press is noticed late, and until then it is taken for drift. So what was known after each of the last blocks is kept,
and a taxel that turns out to be touched is put back to where it was before it began.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.first_order import mean_decay
from posfet_model._lib.types import Array, Mask

MEMORIES: Final = (100.0, 10.0, 1.0)
"""T_k [s]. The first part wanders as fast as a process of that memory, but for ever."""

FAST: Final = 0.1
"""Memory of the fastest process, which is not followed but counted as white noise [s]."""

BLOCKS: Final = 12
"""Blocks that are remembered."""

PRESSING: Final = 1.5
"""A mean so many standard deviations of its noise above zero may be the beginning of a touch [1]."""

PARTS: Final = len(MEMORIES)
_RATES: Final = np.array([0.0] + [1.0 / memory for memory in MEMORIES[1:]])


@dataclass(frozen=True)
class Zeros:
    """What is known of some taxels."""

    parts: Array
    """Of the offset [N], shape [PARTS, taxels]."""
    covariance: Array
    """Of (d, e_k) [N2], shape [1 + PARTS, 1 + PARTS, taxels]; the first column is that row and not kept up."""
    shift: Array
    """Sum of what corrections added to the force, less what the offsets in use took off it [N], shape [taxels]."""

    @classmethod
    def of(cls, *before: int) -> Zeros:
        """Return zeros for a shape, taxels last."""
        *many, taxels = before
        side = 1 + PARTS
        return cls(np.zeros((*many, PARTS, taxels)), np.zeros((*many, side, side, taxels)), np.zeros((*many, taxels)))


class ZeroFilter:
    """Offsets of all taxels and their covariance with the error of the force."""

    def __init__(self, time_constant: Array, noise_variance: Array, flicker: float, drift: float) -> None:
        """Take the leak's time constants [s] and the variance of a reading [N2], shapes [taxels].

        flicker [N2] is K^2, the density of the 1/f noise at 1 Hz times 1 Hz; drift [N2/s] the variance that unseen
        temperature adds to the force.
        """
        taxels = len(time_constant)
        self.time_constant = time_constant
        self.offset = np.zeros(taxels)
        """Sum of its parts [N]; not to be written to."""
        self.noise_variance = noise_variance.copy()
        """Variance of a reading of each taxel [N2]; to be written to where it changes."""
        self._drift = drift
        self._decade = flicker * math.log(10.0)
        self._now = Zeros.of(taxels)
        self._time = 0.0
        self._step = 0.0
        self._reach = np.zeros(taxels)
        self._seen = np.zeros((1 + PARTS, taxels))
        self._past = Zeros.of(BLOCKS, taxels)
        self._past_time = np.zeros(BLOCKS)
        self._pressing = np.zeros((BLOCKS, taxels), np.bool_)
        self._newest = 0
        self._filled = 0

    @property
    def variance(self) -> Array:
        """Variance of the force's error d [N2], shape [taxels]; to be written to where more is unknown."""
        variance: Array = self._now.covariance[0, 0]
        return variance

    @property
    def offset_variance(self) -> Array:
        """Variance of the error of the offset [N2], shape [taxels]."""
        variance: Array = self._now.covariance[1:, 1:].sum(axis=(0, 1))
        return variance

    def grow(self, duration: float, squares: float) -> None:
        """Pass a time [s] whose steps have squares that add up to `squares` [s2]."""
        self._time += duration
        self._step = squares / duration
        white = (self.noise_variance * squares + self._fast * duration) / self.time_constant**2
        self._pass(self._now, self.time_constant, duration, white)
        self._now.parts.sum(axis=0, out=self.offset)

    def expect(self, duration: float, noise: Array) -> Array:
        """Return the variance [N2] of the mean force over the last `duration` [s] if nothing touched; for `correct`.

        noise [N2] is the variance of the mean by itself.
        """
        covariance, reach, seen = self._now.covariance, self._reach, self._seen
        np.divide(0.5 * duration, self.time_constant, out=reach)
        np.add.reduce(covariance[:, 1:], axis=1, out=seen)
        seen *= reach
        seen[0] += covariance[0, 0]
        seen[1:] += covariance[0, 1:]
        expected: Array = np.add.reduce(seen[1:])
        expected *= reach
        expected += seen[0]
        expected += noise
        return expected

    def gain(self, expected: Array) -> Array:
        """Return which share of the mean is the force's error [1]."""
        gain: Array = self._seen[0] / expected
        return gain

    def correct(self, where: Mask, mean: Array, expected: Array) -> None:
        """Learn from the mean force [N] of the masked taxels; moving the force is left to the caller, see `move`."""
        gains = np.where(where, self._seen / expected, 0.0)
        parts, covariance = self._now.parts, self._now.covariance
        parts -= gains[1:] * mean
        covariance -= gains[:, None] * self._seen
        parts.sum(axis=0, out=self.offset)

    def move(self, change: Array | float) -> None:
        """Take note of a correction that was added to the force [N]."""
        shift = self._now.shift
        shift += change

    def know_force(self, where: Mask | slice, variance: Array) -> None:
        """Take the force of the masked taxels for known to within a variance [N2]."""
        self._now.covariance[0, 1:, where] = 0.0
        self._now.covariance[0, 0, where] = variance

    @property
    def wander(self) -> float:
        """Variance per time [N2/s] by which an offset wanders for ever."""
        return 2.0 * self._decade / MEMORIES[0]

    def share(self, usable: Mask, offset: float) -> None:
        """Make `offset` [N] the mean of those of the usable taxels, and move all others along."""
        self._now.parts[:] -= self._now.parts[:, usable].mean(axis=1)[:, None]
        self._now.parts[0] += offset
        self._now.parts.sum(axis=0, out=self.offset)

    def doubt(self, where: Mask, variance: Array | float) -> None:
        """Take the offsets of the masked taxels for less well known by a variance [N2]."""
        self._now.covariance[1, 1, where] += variance

    def begin(self, where: Mask, offset: Array, variance: Array, force: Array, common: Array) -> None:
        """Begin anew with the masked taxels.

        Take their offsets [N] with their variance [N2], the variance [N2] of the force, and the covariance [N2] of
        both, shapes [masked].
        """
        now = self._now
        now.parts[:, where] = 0.0
        now.parts[0, where] = offset
        now.covariance[:, :, where] = 0.0
        for part in range(1, PARTS):
            now.covariance[1 + part, 1 + part, where] = self._decade
        now.covariance[1, 1, where] = variance
        now.covariance[0, 1, where] = common
        now.covariance[0, 0, where] = force
        now.parts.sum(axis=0, out=self.offset)

    def lose_force(self) -> None:
        """Take the force for what the signal shows above the offset: its error is then the offset's."""
        covariance = self._now.covariance
        covariance[0, 1:] = -covariance[1:, 1:].sum(axis=0)
        covariance[0, 0] = self.noise_variance - covariance[0, 1:].sum(axis=0)
        self._filled = 0

    def keep(self, mean: Array, noise: Array) -> None:
        """Remember what is known after a block of this mean force [N], whose variance by itself is noise [N2]."""
        index = self._newest = (self._newest + 1) % BLOCKS
        self._past.parts[index] = self._now.parts
        self._past.covariance[index] = self._now.covariance
        self._past.shift[index] = self._now.shift
        self._past_time[index] = self._time
        np.greater(mean, PRESSING * np.sqrt(noise), out=self._pressing[index])
        self._filled = min(self._filled + 1, BLOCKS)

    def undo(self, where: Mask) -> tuple[Array, NDArray[np.intp]]:
        """Put the masked taxels back to before their touch began.

        Return what that adds to the force [N], and by how many blocks, 0 to the one before, both of shape [masked].

        It began in the first of the last blocks that all were above zero, or in the one before.
        """
        taxels = where.nonzero()[0]
        if not self._filled:
            return np.zeros(len(taxels)), np.zeros(len(taxels), np.intp)
        pressing = np.ones(len(taxels), np.bool_)
        age = np.zeros(len(taxels), np.intp)
        for back in range(self._filled - 1):
            pressing &= self._pressing[(self._newest - back) % BLOCKS, taxels]
            if not pressing.any():
                break
            age += pressing
        age = np.minimum(age + 1, self._filled - 1)
        index = (self._newest - age) % BLOCKS
        then = Zeros(
            np.ascontiguousarray(self._past.parts[index, :, taxels].T),
            np.ascontiguousarray(np.moveaxis(self._past.covariance[index, :, :, taxels], 0, -1)),
            self._past.shift[index, taxels],
        )
        passed = self._time - self._past_time[index]
        tau = self.time_constant[taxels]
        self._pass(then, tau, passed, (self.noise_variance[taxels] * self._step + self._fast) * passed / tau**2)
        change: Array = then.shift - self._now.shift[taxels]
        self._now.parts[:, taxels] = then.parts
        self._now.covariance[:, :, taxels] = then.covariance
        self._now.shift[taxels] = then.shift
        self._now.parts.sum(axis=0, out=self.offset)
        return change, age

    @property
    def _fast(self) -> float:
        """Variance per time that the fast part of the 1/f noise adds, as white noise [N2 s]."""
        return 2.0 * self._decade * FAST

    def _pass(self, zeros: Zeros, tau: Array, duration: float | Array, white: Array) -> None:
        """Pass a time [s], one for all taxels or one for each, in which the force gathers `white` noise [N2]."""
        kept, mean = _memory(duration) if isinstance(duration, float) else _fade(duration)
        reach = mean * (duration / tau)
        covariance = zeros.covariance
        cross, inner = covariance[0, 1:], covariance[1:, 1:]
        shift, parts = zeros.shift, zeros.parts
        shift -= np.einsum("ij,ij->j", reach, parts)
        parts *= kept
        moved = np.einsum("ijk,jk->ik", inner, reach)
        covariance[0, 0] += np.einsum("ij,ij->j", moved - 2.0 * cross, reach)
        covariance[0, 0] += white + self._drift * duration
        cross -= moved
        cross *= kept
        inner *= kept[:, None] * kept
        inner[0, 0] += self.wander * duration
        own = np.einsum("iij->ij", inner)[1:]  # a view
        own += self._decade * (1.0 - kept[1:] ** 2)


def _fade(duration: Array) -> tuple[Array, Array]:
    """Return a_k and m_k for times [s] of shape [n], shapes [PARTS, n]."""
    ratio = np.multiply.outer(_RATES, duration)
    return np.exp(-ratio), mean_decay(ratio)


@lru_cache(maxsize=64)
def _memory(duration: float) -> tuple[Array, Array]:
    """The same for one time, shapes [PARTS, 1]; not to be written to."""
    return _fade(np.array([duration]))
