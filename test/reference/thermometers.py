# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of what is new in the readings of the chip's temperature sensors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray


class Thermometers:
    """Mean change of the chip temperature since the start, from sensors that may appear and disappear.

    Each sensor contributes its change since its first reading, so one that appears or disappears does not shift the
    mean. A sensor that stops reporting (NaN) gives no new reading. One that jumps faster than a chip can warm did not
    measure its temperature: it contributes its change from then on.

    State variables: time [s]; for each sensor the last reading [degC], when it came [s], and the reading at a mean
    change of zero [degC]; the mean change [K]; when the last reading came, and the interval of the readings [s].
    """

    FASTEST: Final = 3.0
    """Greatest rate of a temperature [K/s], assumed."""
    NOISE: Final = 0.1
    """Change of a reading by noise and rounding that is always accepted [K], assumed."""
    GROWTH: Final = 1.1
    """Growth of the interval of the readings with each one that takes longer [1]."""

    def __init__(self) -> None:
        self._raw = b""
        self._last: dict[int, float] = {}
        self._came: dict[int, tuple[float, float]] = {}
        self._offset: dict[int, float] = {}
        self._time = 0.0
        self._mean = 0.0
        self._began = False
        self._newest = self.interval = math.nan

    @property
    def known(self) -> bool:
        """Whether a sensor reported in the last scan."""
        return bool(self._last)

    @property
    def temperature(self) -> float:
        """Mean of all sensors that ever reported [degC]; NaN: none."""
        return sum(self._offset.values()) / len(self._offset) + self._mean if self._offset else math.nan

    def read(self, temperatures: NDArray[np.float32], step: float) -> float:
        """Return the mean change in a new reading [K]; NaN without one.

        Parameters
        ----------
        temperatures : ndarray of float32, shape [sensors]
            Readings [degC]; NaN: the sensor does not report.
        step : float
            Time since the previous scan [s]; inf: unknown.
        """
        if math.isfinite(step):
            self._time += step
        else:
            self._came.clear()
            self._newest = math.nan
        raw = temperatures.tobytes()
        if raw == self._raw:
            return math.nan
        self._raw = raw
        values = {index: value for index, value in enumerate(temperatures.tolist()) if math.isfinite(value)}
        changed = {index: value for index, value in values.items() if self._last.get(index) != value}
        self._last = values
        for index, value in changed.items():
            if self._jumped(index, value):
                del self._offset[index]
            self._came[index] = value, self._time
        known = [value - self._offset[index] for index, value in values.items() if index in self._offset]
        if known:
            self._mean = sum(known) / len(known)
        for index, value in values.items():
            self._offset.setdefault(index, value - self._mean)
        if not changed:
            return math.nan
        since = self._time - self._newest
        if math.isfinite(since):
            self.interval = since if math.isnan(self.interval) else min(since, self.GROWTH * self.interval)
        self._newest, self._began = (self._time if self._began else math.nan), True
        return self._mean

    def _jumped(self, index: int, value: float) -> bool:
        """Return whether a sensor's reading changed faster than a temperature can."""
        if index not in self._came:
            return False
        before, time = self._came[index]
        return abs(value - before) > self.NOISE + self.FASTEST * (self._time - time)
