# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Random walk of the chip temperature, observed while nothing touches."""

from __future__ import annotations

import math
from typing import Final

LEAST_TIME: Final = 0.1
"""Time between two observed temperatures [s]: longer than the lag of a film."""

MEMORY: Final = 100
"""Number of observations over which the walk is averaged [1]: 10 s."""

SURPRISING: Final = 5.0
"""Deviations beyond which an observation counts for no more [1]: a rate that changes is no walk."""


class _Intensity:
    """Intensity of a walk as the mean square of what it explains, at least a given one [K2/s].

    State variables: the mean, and the number of observations.
    """

    def __init__(self, least: float) -> None:
        self._least = self._mean = least
        self._count = 1
        self.value = least
        """The intensity, and its standard error, as it must not be too small [K2/s]."""

    def observe(self, square: float, noise: float, per_intensity: float) -> None:
        """Process a square [K2] with the variance of its noise [K2], and its variance per intensity [s]."""
        most = SURPRISING * SURPRISING * (self.value * per_intensity + noise)
        self._count = min(self._count + 1, MEMORY)
        self._mean += ((min(square, most) - noise) / per_intensity - self._mean) / self._count
        self._mean = max(self._mean, 0.0)
        self.value = max(self._mean * (1.0 + math.sqrt(2.0 / self._count)), self._least)


class TemperatureWalk:
    """Random walk of the chip temperature, from differences of the film's.

    The film follows the chip with the time constant tau. Where the chip walks with the intensity q, its rises over
    times W that follow each other have the covariances ``r0 = q (W - tau g)``, ``r1 = q tau g^2/2`` and
    ``r2 = r1 (1 - g)`` with ``g = 1 - exp(-W/tau)``. The variance of second differences of the temperature is
    ``2 r0 - 2 r1``, of third ones ``6 r0 - 8 r1 + 2 r2``. A constant rate affects neither. One that changes steadily,
    as at the start of a ramp, affects the second ones: they say how uncertain the temperature is, the third ones how
    much of it is a walk.

    State variables: both intensities, the greatest that was a walk, the last two rates, and the sums of the one that is
    not complete.

    Parameters
    ----------
    least : float
        Least random walk, and that until it is observed [K/sqrt(s)].
    film_lag : float
        Time constant of the film's lag behind the chip [s], >= 0.
    """

    def __init__(self, least: float, film_lag: float) -> None:
        self._lag = film_lag
        self._greatest = least * least
        self._any, self._walk = _Intensity(self._greatest), _Intensity(self._greatest)
        self.pause()

    @property
    def intensity(self) -> float:
        """Variance by which the temperature grows in each second, by a walk or by a rate that changes [K2/s]."""
        return self._any.value

    def pause(self) -> None:
        """Forget the temperatures, as the next ones do not follow them."""
        self._rates = (math.nan, math.nan)
        self._rise = self._time = 0.0

    def observe(self, rise: float, variance: float, duration: float) -> None:
        """Process the rise of the film's temperature from one block to the next.

        Parameters
        ----------
        rise : float
            Rise [K].
        variance : float
            Variance of the noise of each of both temperatures [K2].
        duration : float
            Time between the middles of the blocks [s].
        """
        self._rise += rise
        self._time += duration
        if self._time < LEAST_TIME:
            return
        time, rate = self._time, self._rise / self._time
        second = (rate - self._rates[1]) * time
        third = second - (self._rates[1] - self._rates[0]) * time
        self._rates = self._rates[1], rate
        self._rise = self._time = 0.0
        per_second, per_third = self._shown(time)
        if not math.isnan(second):
            self._any.observe(second * second, 6.0 * variance, per_second)
        if not math.isnan(third):
            self._walk.observe(third * third, 20.0 * variance, per_third)

    def take_growth(self) -> float:
        """Return by how much the intensity of the walk exceeds the greatest so far [K2/s], which it is from now on."""
        growth = max(self._walk.value - self._greatest, 0.0)
        self._greatest += growth
        return growth

    def _shown(self, time: float) -> tuple[float, float]:
        """Return the variances of second and third differences over such times, per intensity [s]."""
        if self._lag <= 0.0:
            return 2.0 * time, 6.0 * time
        gone = -math.expm1(-time / self._lag)
        rise, following = time - self._lag * gone, 0.5 * self._lag * gone * gone
        return 2.0 * (rise - following), 6.0 * rise - 8.0 * following + 2.0 * following * (1.0 - gone)
