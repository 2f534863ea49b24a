# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Kalman filter of the baseline: error of each taxel's force, and the amplifier offset that causes it.

With d the error of the force and e_k those of the components of the amplifier offset o [N], a time T brings

    d <- d - (T/tau)*sum(m_k*e_k) + white noise + unobserved temperature,    m_k = (1 - a_k)*T_k/T
    e_k <- a_k*e_k + noise of variance K^2*ln(10)*(1 - a_k^2),               a_k = exp(-T/T_k)

as 1/f noise of density K^2/f is the sum of first-order Markov processes, one per decade of the time constant T_k, each
of variance K^2*ln(10). The filter has one component for each time constant that matters to a held force, and one random
walk. Where nothing touches, the mean of the force over a block measures d half a block ago: d + T/(2*tau)*sum(e_k) and
white noise. While something touches nothing is measured, and each component decays to 0 with its time constant.

A press is detected late, and until then it is absorbed as drift. So the states after each of the last blocks are kept,
and a taxel on which a touch is detected is rolled back to its state before the touch began.
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

TIME_CONSTANTS: Final = (100.0, 10.0, 1.0)
"""T_k [s]. The first component is a random walk with the rate of a process of that time constant."""

FASTEST_TIME_CONSTANT: Final = 0.1
"""Time constant of the fastest process, which counts as white noise and has no state [s]."""

BLOCKS: Final = 12
"""Number of blocks whose states are kept."""

PRESSING: Final = 1.5
"""Standard deviations of its noise above zero from which a block mean may be the onset of a touch [1]."""

COMPONENTS: Final = len(TIME_CONSTANTS)
_RATES: Final = np.array([0.0] + [1.0 / time_constant for time_constant in TIME_CONSTANTS[1:]])


@dataclass(frozen=True)
class DriftState:
    """State of the drift filter for some taxels."""

    components: Array
    """Components of the offset [N], shape [COMPONENTS, taxels]."""
    covariance: Array
    """Covariance of (d, e_k) [N2], shape [1 + COMPONENTS, 1 + COMPONENTS, taxels]; the first row is valid, the first
    column below it is not updated."""
    shift: Array
    """Sum of the corrections added to the force, less the leakage of the estimated offsets [N], shape [taxels]."""

    @classmethod
    def zeros(cls, *shape: int) -> DriftState:
        """Return a state of zeros for a shape, taxels last."""
        *many, taxels = shape
        side = 1 + COMPONENTS
        return cls(
            np.zeros((*many, COMPONENTS, taxels)), np.zeros((*many, side, side, taxels)), np.zeros((*many, taxels))
        )


class DriftFilter:
    """Kalman filter of the offsets of all taxels and of the error of their forces.

    State variables per taxel: components of the offset [N], covariance of force error and offset components [N2], sum
    of the corrections of the force [N]; the states after the last `BLOCKS` blocks.

    Parameters
    ----------
    time_constant : ndarray of float64, shape [taxels]
        Leakage time constants tau [s]; not copied.
    noise_variance : ndarray of float64, shape [taxels]
        Variance of a reading [N2].
    flicker : float
        K^2, the density of the 1/f noise at 1 Hz times 1 Hz [N2].
    temperature_drift : float
        Variance that the unobserved temperature adds to the force per time [N2/s].
    """

    def __init__(self, time_constant: Array, noise_variance: Array, flicker: float, temperature_drift: float) -> None:
        taxels = len(time_constant)
        self.time_constant = time_constant
        self.offset = np.zeros(taxels)
        """Sum of the components [N]; read-only."""
        self.noise_variance = noise_variance.copy()
        """Variance of a reading of each taxel [N2]; written by others when it changes."""
        self._temperature_drift = temperature_drift
        self._decade = flicker * math.log(10.0)
        self._now = DriftState.zeros(taxels)
        self._time = 0.0
        self._step = 0.0
        self._ratio = np.zeros(taxels)
        self._projection = np.zeros((1 + COMPONENTS, taxels))
        self._past = DriftState.zeros(BLOCKS, taxels)
        self._past_time = np.zeros(BLOCKS)
        self._pressing = np.zeros((BLOCKS, taxels), np.bool_)
        self._newest = 0
        self._filled = 0

    @property
    def variance(self) -> Array:
        """Variance of the error d of the force [N2], shape [taxels]; increased by others in place."""
        variance: Array = self._now.covariance[0, 0]
        return variance

    @property
    def offset_variance(self) -> Array:
        """Variance of the offset [N2], shape [taxels]."""
        variance: Array = self._now.covariance[1:, 1:].sum(axis=(0, 1))
        return variance

    def predict(self, duration: float, squares: float) -> None:
        """Propagate the state by `duration` [s], made of steps whose squares sum up to `squares` [s2].

        Parameters
        ----------
        duration : float
            Duration [s].
        squares : float
            Sum of the squares of the steps [s2].
        """
        self._time += duration
        self._step = squares / duration
        white = (self.noise_variance * squares + self._fast * duration) / self.time_constant**2
        self._propagate(self._now, self.time_constant, duration, white)
        self._now.components.sum(axis=0, out=self.offset)

    def innovation_variance(self, duration: float, noise: Array) -> Array:
        """Return the variance of the mean force over the last `duration` [s] without touch; needed by `update`.

        Parameters
        ----------
        duration : float
            Duration of the block [s].
        noise : ndarray of float64, shape [taxels]
            Variance of the mean due to noise alone [N2].

        Returns
        -------
        ndarray of float64, shape [taxels]
            Innovation variance [N2].
        """
        covariance, ratio, projection = self._now.covariance, self._ratio, self._projection
        np.divide(0.5 * duration, self.time_constant, out=ratio)
        np.add.reduce(covariance[:, 1:], axis=1, out=projection)
        projection *= ratio
        projection[0] += covariance[0, 0]
        projection[1:] += covariance[0, 1:]
        expected: Array = np.add.reduce(projection[1:])
        expected *= ratio
        expected += projection[0]
        expected += noise
        return expected

    def gain(self, expected: Array) -> Array:
        """Return the Kalman gain of the force error [1], given the innovation variance [N2]."""
        gain: Array = self._projection[0] / expected
        return gain

    def update(self, where: Mask, mean: Array, expected: Array) -> None:
        """Update the masked taxels by their mean force [N], given the innovation variance [N2].

        The caller corrects the force itself, and reports that by `record_correction`.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels concerned.
        mean : ndarray of float64, shape [taxels]
            Mean force over the block [N].
        expected : ndarray of float64, shape [taxels]
            Innovation variance [N2].
        """
        gains = np.where(where, self._projection / expected, 0.0)
        components, covariance = self._now.components, self._now.covariance
        components -= gains[1:] * mean
        covariance -= gains[:, None] * self._projection
        components.sum(axis=0, out=self.offset)

    def record_correction(self, change: Array | float) -> None:
        """Record a correction that was added to the force [N]."""
        shift = self._now.shift
        shift += change

    def reset_force_error(self, where: Mask | slice, variance: Array) -> None:
        """Set the variance of the force error of the masked taxels [N2], uncorrelated with the offset.

        Parameters
        ----------
        where : ndarray of bool or slice
            Taxels concerned.
        variance : ndarray of float64
            Variance of the force error [N2] of the taxels concerned.
        """
        self._now.covariance[0, 1:, where] = 0.0
        self._now.covariance[0, 0, where] = variance

    @property
    def random_walk(self) -> float:
        """Variance per time of the random walk of an offset [N2/s]."""
        return 2.0 * self._decade / TIME_CONSTANTS[0]

    def set_mean_offset(self, usable: Mask, offset: float) -> None:
        """Shift all offsets so that the mean of those of the usable taxels is `offset` [N].

        Parameters
        ----------
        usable : ndarray of bool, shape [taxels]
            Taxels that work.
        offset : float
            Mean offset [N].
        """
        self._now.components[:] -= self._now.components[:, usable].mean(axis=1)[:, None]
        self._now.components[0] += offset
        self._now.components.sum(axis=0, out=self.offset)

    def inflate_offset_variance(self, where: Mask, variance: Array | float) -> None:
        """Increase the variance of the offsets of the masked taxels [N2].

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels concerned.
        variance : ndarray of float64 or float
            Increase of the variance [N2].
        """
        self._now.covariance[1, 1, where] += variance

    def restart(self, where: Mask, offset: Array, variance: Array, force: Array, common: Array) -> None:
        """Restart the masked taxels.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels to restart.
        offset : ndarray of float64, shape [masked]
            Their offsets [N].
        variance : ndarray of float64, shape [masked]
            Variance of the offsets [N2].
        force : ndarray of float64, shape [masked]
            Variance of the force error [N2].
        common : ndarray of float64, shape [masked]
            Covariance of force error and offset [N2].
        """
        now = self._now
        now.components[:, where] = 0.0
        now.components[0, where] = offset
        now.covariance[:, :, where] = 0.0
        for component in range(1, COMPONENTS):
            now.covariance[1 + component, 1 + component, where] = self._decade
        now.covariance[1, 1, where] = variance
        now.covariance[0, 1, where] = common
        now.covariance[0, 0, where] = force
        now.components.sum(axis=0, out=self.offset)

    def reset_force_to_signal(self) -> None:
        """Record that the force was set to the signal above the offset: its error is that of the offset."""
        covariance = self._now.covariance
        covariance[0, 1:] = -covariance[1:, 1:].sum(axis=0)
        covariance[0, 0] = self.noise_variance - covariance[0, 1:].sum(axis=0)
        self._filled = 0

    def forget(self) -> None:
        """Forget the states after earlier blocks: a touch that begins does not roll back to them."""
        self._filled = 0

    def store(self, mean: Array, noise: Array) -> None:
        """Keep the state after a block of this mean force [N], whose noise has the variance `noise` [N2].

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean force over the block [N].
        noise : ndarray of float64, shape [taxels]
            Variance of that mean by noise [N2].
        """
        index = self._newest = (self._newest + 1) % BLOCKS
        self._past.components[index] = self._now.components
        self._past.covariance[index] = self._now.covariance
        self._past.shift[index] = self._now.shift
        self._past_time[index] = self._time
        np.greater(mean, PRESSING * np.sqrt(noise), out=self._pressing[index])
        self._filled = min(self._filled + 1, BLOCKS)

    def roll_back(self, where: Mask) -> tuple[Array, NDArray[np.intp]]:
        """Return the masked taxels to their state before the touch began.

        The touch began in the first of the consecutive last blocks with a mean above zero, or in the block before.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels to roll back.

        Returns
        -------
        change : ndarray of float64, shape [masked]
            Correction to be added to the force [N].
        blocks : ndarray of intp, shape [masked]
            Number of blocks rolled back; 0: to the state after the previous block.
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
        then = DriftState(
            np.ascontiguousarray(self._past.components[index, :, taxels].T),
            np.ascontiguousarray(np.moveaxis(self._past.covariance[index, :, :, taxels], 0, -1)),
            self._past.shift[index, taxels],
        )
        passed = self._time - self._past_time[index]
        tau = self.time_constant[taxels]
        self._propagate(then, tau, passed, (self.noise_variance[taxels] * self._step + self._fast) * passed / tau**2)
        change: Array = then.shift - self._now.shift[taxels]
        self._now.components[:, taxels] = then.components
        self._now.covariance[:, :, taxels] = then.covariance
        self._now.shift[taxels] = then.shift
        self._now.components.sum(axis=0, out=self.offset)
        return change, age

    @property
    def _fast(self) -> float:
        """Spectral density of the fast part of the 1/f noise, which counts as white noise [N2 s]."""
        return 2.0 * self._decade * FASTEST_TIME_CONSTANT

    def _propagate(self, state: DriftState, tau: Array, duration: float | Array, white: Array) -> None:
        """Propagate a state by a time [s], one for all taxels or one for each, with `white` noise of the force [N2]."""
        kept, mean = _cached_decay(duration) if isinstance(duration, float) else _decay(duration)
        ratio = mean * (duration / tau)
        covariance = state.covariance
        cross, inner = covariance[0, 1:], covariance[1:, 1:]
        shift, components = state.shift, state.components
        shift -= np.einsum("ij,ij->j", ratio, components)
        components *= kept
        moved = np.einsum("ijk,jk->ik", inner, ratio)
        covariance[0, 0] += np.einsum("ij,ij->j", moved - 2.0 * cross, ratio)
        covariance[0, 0] += white + self._temperature_drift * duration
        cross -= moved
        cross *= kept
        inner *= kept[:, None] * kept
        inner[0, 0] += self.random_walk * duration
        own = np.einsum("iij->ij", inner)[1:]  # a view
        own += self._decade * (1.0 - kept[1:] ** 2)


def _decay(duration: Array) -> tuple[Array, Array]:
    """Return a_k and m_k for times [s] of shape [n], shapes [COMPONENTS, n]."""
    ratio = np.multiply.outer(_RATES, duration)
    return np.exp(-ratio), mean_decay(ratio)


@lru_cache(maxsize=64)
def _cached_decay(duration: float) -> tuple[Array, Array]:
    """Return a_k and m_k for one time [s], shapes [COMPONENTS, 1]; read-only."""
    return _decay(np.array([duration]))
