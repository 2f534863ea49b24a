# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Whether the film has warmed since before the first scan, in NumPy; posfet_core, estimation/earlier_warming.hpp."""

from __future__ import annotations

import math
from typing import Final

import numpy as np


class EarlierWarming:
    """Line through what the sensors read beyond what is expected, while zeros determine the film's temperature."""

    FEWEST: Final = 8
    """Fewest readings of which the scatter is known."""
    LEAST_READING: Final = 1e-3
    """Least standard deviation of a reading [K]."""
    SIGNIFICANT: Final = 3.0
    """Deviations from which on a rate is significant [1]."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._readings: list[float] = []

    def reset(self) -> None:
        """Forget the readings."""
        self._times.clear()
        self._readings.clear()

    def add(self, time: float, reading: float) -> tuple[float, float] | None:
        """Add a reading; return the rate of the film and its standard deviation [K/s], if it is significant.

        Parameters
        ----------
        time : float
            Time since the start [s].
        reading : float
            Reading less the expected one [K].
        """
        self._times.append(time)
        self._readings.append(reading)
        if len(self._times) < self.FEWEST:
            return None
        times, readings = (np.array(each) - np.mean(each) for each in (self._times, self._readings))
        spread = float(times @ times)
        rate = float(times @ readings) / spread
        left = float(np.square(readings - rate * times).sum()) / (len(times) - 2)
        deviation = math.sqrt(max(left, self.LEAST_READING**2) / spread)
        return None if abs(rate) < self.SIGNIFICANT * deviation else (rate, deviation)
