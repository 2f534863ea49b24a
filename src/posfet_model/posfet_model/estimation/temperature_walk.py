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


class TemperatureWalk:
    """Random walk of the chip temperature, from third differences of the film's.

    Neither a constant rate nor one that changes steadily, as at the start of a ramp, affects them. The film follows the
    chip with the time constant tau. Where the chip walks with the intensity q, its rises over times W that follow each
    other have the covariances ``r0 = q (W - tau g)``, ``r1 = q tau g^2/2`` and ``r2 = r1 (1 - g)`` with
    ``g = 1 - exp(-W/tau)``, and third differences the variance ``6 r0 - 8 r1 + 2 r2``.

    What is used is q and its standard error, at least `least`.

    State variables: q, its greatest value, the number of observations, the last two rates, and the sums of the one that
    is not complete.

    Parameters
    ----------
    least : float
        Least random walk, and that until it is observed [K/sqrt(s)].
    film_lag : float
        Time constant of the film's lag behind the chip [s], >= 0.
    """

    def __init__(self, least: float, film_lag: float) -> None:
        self._least, self._lag = least * least, film_lag
        self.intensity = self._least
        """Variance by which the temperature grows in each second [K2/s]."""
        self._mean = self._greatest = self._least
        self._count = 1
        self.pause()

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
        third = (rate - 2.0 * self._rates[1] + self._rates[0]) * time
        self._rates = self._rates[1], rate
        self._rise = self._time = 0.0
        if math.isnan(third):
            return
        per_intensity = self._shown(time)
        noise = 20.0 * variance
        most = SURPRISING * SURPRISING * (self.intensity * per_intensity + noise)
        self._count = min(self._count + 1, MEMORY)
        self._mean += ((min(third * third, most) - noise) / per_intensity - self._mean) / self._count
        self._mean = max(self._mean, 0.0)
        self.intensity = max(self._mean * (1.0 + math.sqrt(2.0 / self._count)), self._least)

    def take_growth(self) -> float:
        """Return by how much the intensity exceeds the greatest so far [K2/s], which it is from now on."""
        growth = max(self.intensity - self._greatest, 0.0)
        self._greatest += growth
        return growth

    def _shown(self, time: float) -> float:
        """Return the variance of a third difference over such times, per intensity [s]."""
        if self._lag <= 0.0:
            return 6.0 * time
        gone = -math.expm1(-time / self._lag)
        next_rise = 0.5 * self._lag * gone * gone
        return 6.0 * (time - self._lag * gone) - 8.0 * next_rise + 2.0 * next_rise * (1.0 - gone)
