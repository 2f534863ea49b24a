# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Temperature of the piezoelectric film, estimated from the chip's temperature sensors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

UNKNOWN_RANDOM_WALK: Final = 0.05
"""Random walk of the film temperature while no sensor reports [K/sqrt(s)], assumed."""

LAG_UNCERTAINTY: Final = 0.3
"""Relative standard deviation of the thermal lag [1], assumed."""

SLOPE_GAIN: Final = 0.3
"""Gain of a new slope in the running slope, and of a new squared prediction error in its variance [1], assumed."""

OVERDUE: Final = 1.5
"""A reading is extrapolated for at most this many times the interval before it [1]: after that there was a new reading
with the same value."""

LONGEST_INTERVAL: Final = 0.5
"""Readings further apart than this are not extrapolated [s], assumed: board status comes at 10 Hz."""

FASTEST_CORRECTION: Final = 2.0
"""Greatest rate at which the film departs from the temperature estimated from the sensors [K/s], assumed."""

NOTICEABLE_ERROR: Final = 5e-3
"""Prediction error of the chip temperature above which the film may differ from its estimate [K]."""

NOTICEABLE_SLOPE: Final = 0.2
"""Slope of the chip temperature above which the film may differ from its estimate [K/s]."""

STEADY_SLOPE: Final = 0.03
"""A slope above this is a ramp, not a random walk [K/s]."""

NEGLIGIBLE_LAG: Final = 1e-3
"""A lag below this does not affect an offset [K]: it changes the force by 1 mN within 50 ms."""

TRANSIENT_LAGS: Final = 5.0
"""Duration of a thermal transient, in time constants of the film's lag [1]."""

ZERO_LAG: Final = 1e-9
"""A lag below this is zero [K]."""


class FilmTemperature:
    """Change of the film temperature since the start, from sensors that may appear and disappear.

    Readings are less frequent than scans: between two readings the chip temperature is extrapolated along its slope.
    The film follows the chip with a first-order lag. Each sensor contributes its change since its first reading, so
    a sensor that appears or disappears does not shift the mean. While no sensor reports, the temperature is held and
    its uncertainty grows.

    State variables: chip temperature [K] and its slope [K/s], lag of the film behind the chip [K], common-mode
    correction of the film [K], variances of the prediction and of the missing readings [K2].

    Parameters
    ----------
    time_constant : float
        Time constant of the film's lag [s], >= 0; 0: no lag.
    """

    def __init__(self, time_constant: float) -> None:
        self.time_constant = time_constant
        """Time constant of the lag [s]."""
        self.reading = math.nan
        """Chip temperature since the start in the last reading [K]; NaN: no sensor reports."""
        self._last: list[float] = []
        self._known: dict[int, float] = {}
        self._bias: dict[int, float] = {}
        self._chip = 0.0
        self._slope = 0.0
        self._extrapolated = 0.0
        self._transient = 0.0
        self.step = 0.0
        """Duration of the last update [s]."""
        self.rate = 0.0
        """Rate of change of the film temperature in the last update [K/s]."""
        self._age = 0.0
        self._interval = 0.0
        self._lag = 0.0
        self._correction = 0.0
        self._prediction_variance = 0.0
        self._unknown_variance = 0.0

    @property
    def standard_deviation(self) -> float:
        """Standard uncertainty of the film's temperature change [K]."""
        lag = LAG_UNCERTAINTY * (self._lag + self._correction)
        return math.sqrt(self._unknown_variance + self._prediction_variance + lag * lag)

    @property
    def chip(self) -> float:
        """Chip temperature since the start, extrapolated from the sensors [K]."""
        return self._chip

    @property
    def age(self) -> float:
        """Age of the last reading [s]."""
        return self._age

    @property
    def rise_from_sensors(self) -> float:
        """Film temperature since the start according to the sensors alone [K]."""
        return self._chip - self._lag - self._correction

    @property
    def correction(self) -> float:
        """Common-mode correction: estimate of the film temperature less that from the sensors alone [K]."""
        return self._correction

    @property
    def known(self) -> bool:
        """Whether a sensor reported at the last update."""
        return any(math.isfinite(value) for value in self._last)

    @property
    def in_transient(self) -> bool:
        """Whether the chip temperature changed so recently that the film may still differ from its estimate."""
        return self._transient > 0.0

    @property
    def ramping(self) -> bool:
        """Whether the chip warms or cools by more than a random walk."""
        return self._transient > 0.0 or abs(self._slope) > STEADY_SLOPE

    @property
    def steady(self) -> bool:
        """Whether the film is at its estimate: the chip temperature is steady, and the lag is negligible."""
        return self._transient <= 0.0 and abs(self._lag) < NEGLIGIBLE_LAG

    def common_mode_correction(self, change: float, limit: float = math.inf, extend: bool = False) -> float:
        """Correct the film temperature by the common-mode signal; return the correction that was accepted.

        Parameters
        ----------
        change : float
            Correction that the common-mode signal suggests [K].
        limit : float, optional
            Greatest departure from the temperature according to the sensors [K].
        extend : bool, optional
            Allow a departure beyond `limit`, no faster than `FASTEST_CORRECTION`: a faster change has another cause.

        Returns
        -------
        float
            Accepted correction [K].
        """
        margin = FASTEST_CORRECTION * self.step if extend else 0.0
        low, high = min(-limit, self._correction - margin), max(limit, self._correction + margin)
        accepted = min(max(self._correction + change, low), high) - self._correction
        self._lag -= accepted
        self._correction += accepted
        return accepted

    def keep_correction(self) -> None:
        """Make the correction permanent: the sensors alone do not bring the film back."""
        self._lag += self._correction
        self._correction = 0.0

    def revert_correction(self) -> float:
        """Return the film to the temperature according to the sensors; return the change that this makes [K]."""
        back, self._correction = self._correction, 0.0
        self._lag += back
        return -back

    def update(self, temperatures: NDArray[np.float32], step: float) -> float:
        """Advance the film temperature by one step.

        Parameters
        ----------
        temperatures : ndarray of float32, shape [sensors]
            Readings at the end of the step [degC]; NaN: the sensor does not report.
        step : float
            Duration of the step [s].

        Returns
        -------
        float
            Change of the film temperature over the step [K].
        """
        readings: list[float] = temperatures.tolist()
        self.step = step
        self._age += step
        self._transient -= step
        if readings != self._last and self._is_new(readings):  # always different while one is NaN
            self._read(readings, step)
        elif self._slope or self._prediction_variance:
            self._extrapolate(step)
        if self._lag == 0.0:
            self.rate = 0.0
            return 0.0
        share = -math.expm1(-step / self.time_constant) if self.time_constant > 0 else 1.0
        change = share * self._lag
        self._lag -= change
        self._correction -= share * self._correction
        self.rate = change / step if step > 0.0 else 0.0
        if abs(self._lag) < ZERO_LAG:
            self._lag = 0.0
        return change

    def _is_new(self, readings: list[float]) -> bool:
        """Keep readings [degC]; return whether one is new, or none is known. A sensor that stops gives no new one."""
        self._last = readings
        known = {index: value for index, value in enumerate(readings) if math.isfinite(value)}
        new = any(self._known.get(index) != value for index, value in known.items())
        self._known.update(known)
        return new or not known or math.isnan(self.reading)

    def _extrapolate(self, step: float) -> None:
        """Move the chip temperature along its slope, or back to the last reading when a new one is overdue."""
        interval = min(self._interval, LONGEST_INTERVAL)
        if self._age <= OVERDUE * interval:
            change = self._slope * step
            self._extrapolated += change
        else:
            change = -self._extrapolated
            self._slope = self._extrapolated = 0.0
            # Constant readings are predicted without error.
            self._prediction_variance *= math.exp(-SLOPE_GAIN * step / interval)
            if self._prediction_variance < ZERO_LAG * ZERO_LAG:
                self._prediction_variance = 0.0
        self._chip += change
        self._lag += change

    def _read(self, readings: list[float], step: float) -> None:
        """Move the chip temperature to new readings; update slope, prediction variance and unknown variance."""
        known = [(index, value) for index, value in enumerate(readings) if math.isfinite(value)]
        if not known:
            self.reading = math.nan
            self._unknown_variance += UNKNOWN_RANDOM_WALK**2 * step if self._bias else 0.0
            self._slope = self._extrapolated = 0.0
            return
        for index, value in known:
            self._bias.setdefault(index, value - self._chip)
        self.reading = chip = sum(value - self._bias[index] for index, value in known) / len(known)
        # Error of the prediction for this scan; the chip temperature lacks the part of the last step.
        error = chip - self._chip - self._slope * step
        if abs(error) > NOTICEABLE_ERROR or abs(self._slope) > NOTICEABLE_SLOPE:
            self._transient = TRANSIENT_LAGS * self.time_constant + 2.0 * min(self._age, LONGEST_INTERVAL)
        self._lag += chip - self._chip
        self._chip = chip
        self._extrapolated = 0.0
        if self._unknown_variance or self._age > LONGEST_INTERVAL:
            self._unknown_variance = 0.0  # the reading includes the change that was missed
            self._slope = 0.0
        else:
            self._slope += SLOPE_GAIN * error / self._age
            self._prediction_variance += SLOPE_GAIN * (error * error - self._prediction_variance)
        self._interval, self._age = self._age, 0.0
