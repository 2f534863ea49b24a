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

from reference.estimation.known_forces import GATE

LEAST_TIME: Final = 0.1
"""Time between two observed temperatures [s]: longer than the lag of a film."""

MEMORY: Final = 100
"""Number of observations over which the walk is averaged [1]: 10 s."""


class TemperatureWalk:
    """Random walk of the chip temperature, from second differences of the film's, which no constant rate affects.

    The film follows the chip with the time constant tau. Where the chip walks with the intensity q, second differences
    of the film's temperature over times W have the variance ``2 q (W - tau g - tau g^2/2)``, ``g = 1 - exp(-W/tau)``.

    State variables: q, the number of observations, and the sums of the one that is not complete.

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
        self._count = 1
        self.pause()

    def pause(self) -> None:
        """Forget the temperatures, as the next ones do not follow them."""
        self._rate = math.nan
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
        time, before = self._time, self._rate
        self._rate = self._rise / time
        self._rise = self._time = 0.0
        if math.isnan(before):
            return
        per_intensity = 2.0 * self._shown(time)
        noise = 6.0 * variance
        # A rate that changes is no walk.
        most = GATE * GATE * (self.intensity * per_intensity + noise)
        square = min(((self._rate - before) * time) ** 2, most)
        self._count = min(self._count + 1, MEMORY)
        self.intensity += ((square - noise) / per_intensity - self.intensity) / self._count
        self.intensity = max(self.intensity, self._least)

    def _shown(self, time: float) -> float:
        """Return the time for which the film shows the walk of the chip within a time [s]."""
        if self._lag <= 0.0:
            return time
        gone = -math.expm1(-time / self._lag)
        return time - self._lag * gone * (1.0 + 0.5 * gone)
