"""Temperature of the film, followed from the chip's sensors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

UNKNOWN_WANDER: Final = 0.05
"""How fast the film's temperature is taken to wander while no sensor is known [K/sqrt(s)], assumed."""

LAG_UNCERTAINTY: Final = 0.3
"""Relative standard deviation of the thermal lag [1], assumed."""


class FilmTemperature:
    """Change of the film's temperature since the start, from sensors that may come and go.

    The film follows the mean of the known sensors with a first-order lag. A sensor counts by its changes only, and only
    from one reading to the next, so that one that drops out or comes back does not shift the mean. While none is known
    the film's temperature is held and its uncertainty grows.
    """

    def __init__(self, time_constant: float) -> None:
        """Follow with the lag `time_constant` [s], >= 0; 0 follows at once."""
        self._time_constant = time_constant
        self._last: list[float] = []
        self._lag = 0.0
        self._unknown_variance = 0.0

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the film's temperature change [K] beyond the noise of the sensors."""
        return math.sqrt(self._unknown_variance + (LAG_UNCERTAINTY * self._lag) ** 2)

    @property
    def known(self) -> bool:
        """Whether a sensor was known at the last update."""
        return any(value == value for value in self._last)  # noqa: PLR0124 - NaN is the value that differs from itself

    def update(self, temperatures: NDArray[np.float32], step: float) -> float:
        """Return by how much [K] the film warmed over the last `step` [s], for the sensors' readings [degC] at its end.

        The sensors' readings jump at the start of the step and hold: they come less often than the scans.
        """
        readings: list[float] = temperatures.tolist()
        if readings != self._last:  # always so while one is NaN
            self._lag += self._chip_change(readings, step)
            self._last = readings
        if self._lag == 0.0:
            return 0.0
        share = -math.expm1(-step / self._time_constant) if self._time_constant > 0 else 1.0
        change = share * self._lag
        self._lag -= change
        if abs(self._lag) < 1e-9:
            self._lag = 0.0
        return change

    def _chip_change(self, readings: list[float], step: float) -> float:
        """Return the mean change [K] of the sensors known both before and now; keep count of what is not known."""
        changes = [new - old for new, old in zip(readings, self._last, strict=False) if math.isfinite(new - old)]
        if not changes and self._last:
            self._unknown_variance += UNKNOWN_WANDER**2 * step
        return sum(changes) / len(changes) if changes else 0.0
