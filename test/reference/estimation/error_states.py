# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The shared states at the start, and how they change, in NumPy; posfet_core, estimation/error_states.hpp, says why."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_core import scan_path
from posfet_model._lib.types import Array
from posfet_model.estimation.error_states import BENDS, COUNT, ErrorPriors, Shared

NEGLIGIBLE: Final = 1e-6
"""Deviation of the temperatures at the start, which are zero by definition [K]; not 0, for a regular covariance."""


def start_belief(taxels: int, shared: Array, covariance: Array) -> scan_path.Belief:
    """Return a belief without force errors, with shared states and their covariance."""
    own, size = scan_path.OWN_STATES, len(shared)
    return scan_path.Belief(
        shared, covariance, np.zeros((taxels, own)), np.zeros((taxels, own, size)), np.zeros((taxels, own, own))
    )


def start_covariance(priors: ErrorPriors) -> Array:
    """Return the covariance of the shared states at the start, shape [COUNT, COUNT]."""
    deviations = np.zeros(COUNT)
    deviations[[Shared.CHIP, Shared.FILM, Shared.SENSOR]] = NEGLIGIBLE
    deviations[Shared.RATE] = priors.rate
    deviations[Shared.LAG] = priors.lag_spread
    deviations[Shared.SCALE] = priors.scale
    deviations[Shared.EARLIER] = priors.earlier
    deviations[Shared.ZERO] = priors.reading
    deviations[Shared.BEND : Shared.BEND + BENDS] = priors.bend
    deviations[Shared.LEAK] = priors.leak
    deviations[Shared.WARMTH] = priors.warmth
    deviations[Shared.WEAK_WARMTH] = priors.warmth_contact * max(abs(priors.warmth_mean), priors.warmth)
    deviations[Shared.TAIL] = priors.tail_spread
    deviations[Shared.DRIFT] = priors.drift
    deviations[Shared.CREEP :] = priors.creep
    return np.diag(np.square(deviations))


def start_mean(priors: ErrorPriors) -> Array:
    """Return the shared states at the start, shape [COUNT]."""
    state = np.zeros(COUNT)
    state[Shared.LAG] = math.log(priors.lag)
    state[Shared.TAIL] = priors.tail
    state[Shared.BEND : Shared.BEND + BENDS] = priors.bend_mean
    state[Shared.WARMTH] = priors.warmth_mean
    state[Shared.CREEP :] = priors.creep_mean
    return state


class SharedDynamics:
    """Transition of the shared states over a block.

    Chip, film and sensors: ``C' = U``, ``Theta' = (C - Theta)/tau_film``, ``S' = (C - S)/exp(l)``; the others are
    constant, but for a small random walk by which they forget in about an hour.

    Parameters
    ----------
    priors : ErrorPriors
        Noise of the states.
    film_lag : float
        Time constant of the film's lag behind the chip [s], >= 0.
    """

    FORGET: Final = 3600.0
    """Time in which a constant state becomes uncertain again [s]."""
    LEAST_LAG: Final = -7.0
    """Least logarithm of the time constant of the sensors' lag that makes a difference [1]: 0.9 ms."""
    GREATEST_LAG: Final = 3.0
    """Greatest one [1]: 20 s."""

    def __init__(self, priors: ErrorPriors, film_lag: float) -> None:
        self._film_lag = film_lag
        self._rate_change, self._slow_rate = priors.rate_change, priors.slow_rate
        self._dead_share = priors.dead_share
        rates = np.diag(start_covariance(priors)).copy() / self.FORGET
        rates[Shared.RATE] = priors.rate_walk**2
        rates[[Shared.SENSOR, Shared.EARLIER, Shared.ZERO, Shared.DRIFT, Shared.TAIL]] = 0.0
        self._noise = np.diag(rates)
        self._duration, self._matrix = math.nan, np.eye(COUNT)
        self.set_film_walk(priors.film_walk**2)

    def set_film_walk(self, intensity: float) -> None:
        """Set the variance by which the temperature of chip and film grows in each second [K2/s]."""
        both = [Shared.CHIP, Shared.FILM]
        self._noise[np.ix_(both, both)] = intensity

    def transition(self, state: Array, duration: float, warming: float = 0.0) -> tuple[Array, Array, Array]:
        """Return the next state, the transition matrix and the covariance of the process noise of a block.

        Parameters
        ----------
        state : ndarray of float64, shape [COUNT]
            State at its start.
        duration : float
            Duration of the block [s].
        warming : float, default 0.0
            Rate at which the chip warms beyond that of the state [K/s].
        """
        if duration != self._duration:  # nearly all blocks have the same
            self._duration = duration
            self._matrix = np.eye(COUNT)
            self._matrix[Shared.CHIP, Shared.RATE] = duration
            self._follow(self._matrix, Shared.FILM, self._film_lag, duration)
        matrix = self._matrix.copy()
        lag, time = float(state[Shared.LAG]), self.sensor_lag(state)
        self._follow(matrix, Shared.SENSOR, time, duration)
        after = matrix @ state
        thermal = [Shared.CHIP, Shared.FILM, Shared.SENSOR]
        after[thermal] += matrix[thermal, Shared.RATE] * warming
        if self.LEAST_LAG < lag < self.GREATEST_LAG:
            # Derivative of the sensors' temperature with respect to the logarithm of the time constant.
            ratio, behind = duration / time, state[Shared.CHIP] - state[Shared.SENSOR]
            left, gone = math.exp(-ratio), -math.expm1(-ratio)
            matrix[Shared.SENSOR, Shared.LAG] = (
                state[Shared.RATE] * (duration * left - time * gone) - behind * left * ratio
            )
        noise = self._noise * duration
        rate = abs(state[Shared.RATE])
        if rate:
            noise[Shared.RATE, Shared.RATE] += (
                (self._rate_change * rate) ** 2 * duration * rate / (rate + self._slow_rate)
            )
        # Far behind by a constant rate, sensors with a dead time are as those with a lag of first order.
        behind = state[Shared.CHIP] - state[Shared.SENSOR]
        unlike = self._dead_share * (behind - time * (state[Shared.RATE] + warming)) / time
        noise[Shared.SENSOR, Shared.SENSOR] += unlike**2 * duration * time
        return after, matrix, noise

    def maneuver(self, state: Array, duration: float) -> Array:
        """Return how the shared states change if the rate of the chip temperature changed by 1 K/s, shape [COUNT].

        Parameters
        ----------
        state : ndarray of float64, shape [COUNT]
            State.
        duration : float
            Time since the rate changed [s].
        """
        response: Array = self.transition(state, duration)[1][:, Shared.RATE]
        return response

    @classmethod
    def sensor_lag(cls, state: Array) -> float:
        """Return the time constant of the sensors' lag [s], within what a sensor can have."""
        return math.exp(min(max(float(state[Shared.LAG]), cls.LEAST_LAG), cls.GREATEST_LAG))

    @staticmethod
    def _follow(matrix: Array, row: int, time: float, duration: float) -> None:
        """Let a temperature follow the chip with a time constant [s], exact for a constant rate."""
        ratio = duration / time if time > 0.0 else math.inf
        gone = -math.expm1(-ratio)
        mean = gone / ratio if ratio else 1.0
        matrix[row, row] = math.exp(-ratio)
        matrix[row, Shared.CHIP] = gone
        matrix[row, Shared.RATE] = duration * (1.0 - mean)
