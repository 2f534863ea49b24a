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

SLOPE_SHARE: Final = 0.3
"""Share of a new slope in the running one, and of a new error of prediction in its variance [1], assumed."""

OVERDUE: Final = 1.5
"""A reading is not carried on for longer than this many times the interval before it [1]: then there was a new one, the
same as the last."""

LONGEST_INTERVAL: Final = 0.5
"""Readings further apart than this are not carried on [s], assumed: board status comes at 10 Hz."""

FASTEST_NUDGE: Final = 2.0
"""The film leaves the temperature that was followed no faster than this [K/s], assumed."""

NOTICEABLE_ERROR: Final = 5e-3
"""A chip this far from where it was expected may leave the film elsewhere than followed [K]."""

NOTICEABLE_SLOPE: Final = 0.2
"""A chip that warms or cools this fast may leave the film elsewhere than followed [K/s]."""

STEADY_SLOPE: Final = 0.03
"""A slope above this is no wander [K/s]."""

CAUGHT_UP: Final = 1e-3
"""A lag below this makes no difference to an offset [K]: it changes the force by 1 mN within 50 ms."""

RESTLESS: Final = 5.0
"""For how many lags of the film that lasts [1]."""

SETTLED: Final = 1e-9
"""A lag below this is none [K]."""


class FilmTemperature:
    """Change of the film's temperature since the start, from sensors that may come and go.

    Readings come less often than scans, so between two of them the chip's temperature is carried on along its slope.
    The film follows it with a first-order lag. A sensor counts by its change since it was first seen, so that one that
    drops out or comes back does not shift the mean. While none is known the temperature is held and its uncertainty
    grows.
    """

    def __init__(self, time_constant: float) -> None:
        """Follow with the lag `time_constant` [s], >= 0; 0 follows at once."""
        self.time_constant = time_constant
        """Of the lag [s]."""
        self.told = math.nan
        """Chip temperature since the start as the sensors last told it [K]; NaN: none is known."""
        self._last: list[float] = []
        self._bias: dict[int, float] = {}
        self._chip = 0.0
        self._slope = 0.0
        self._carried = 0.0
        self._restless = 0.0
        self.step = 0.0
        """Duration of the last update [s]."""
        self.rate = 0.0
        """How fast the film warmed in it [K/s]."""
        self._age = 0.0
        self._interval = 0.0
        self._lag = 0.0
        self._nudged = 0.0
        self._prediction_variance = 0.0
        self._unknown_variance = 0.0

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the film's temperature change [K]."""
        lag = LAG_UNCERTAINTY * (self._lag + self._nudged)
        return math.sqrt(self._unknown_variance + self._prediction_variance + lag * lag)

    @property
    def chip(self) -> float:
        """Temperature of the chip since the start, as far as its sensors have told [K]."""
        return self._chip

    @property
    def age(self) -> float:
        """For how long the sensors have told the same [s]."""
        return self._age

    @property
    def warmth(self) -> float:
        """Temperature of the film since the start, by the sensors alone [K]."""
        return self._chip - self._lag - self._nudged

    @property
    def nudged(self) -> float:
        """By how much the film is followed to be warmer than the sensors alone have it [K]."""
        return self._nudged

    @property
    def known(self) -> bool:
        """Whether a sensor was known at the last update."""
        return any(math.isfinite(value) for value in self._last)

    @property
    def changing(self) -> bool:
        """Whether the chip's temperature changed so lately that the film may still be elsewhere than followed."""
        return self._restless > 0.0

    @property
    def warming(self) -> bool:
        """Whether the chip does more than wander: it warms or cools."""
        return self._restless > 0.0 or abs(self._slope) > STEADY_SLOPE

    @property
    def quiet(self) -> bool:
        """Whether the film is where it is followed to: the chip's temperature rests, and the film has caught up."""
        return self._restless <= 0.0 and abs(self._lag) < CAUGHT_UP

    def nudge(self, change: float, most: float = math.inf, further: bool = False) -> float:
        """Take note that the film seems warmer by `change` [K] than followed; return how much of it is believed.

        In all no further than `most` [K] from where the sensors have it; if `further`, beyond that no faster than
        `FASTEST_NUDGE`: what is faster has another cause.
        """
        limit = FASTEST_NUDGE * self.step if further else 0.0
        low, high = min(-most, self._nudged - limit), max(most, self._nudged + limit)
        believed = min(max(self._nudged + change, low), high) - self._nudged
        self._lag -= believed
        self._nudged += believed
        return believed

    def keep_nudges(self) -> None:
        """Take nudges for an error that stays: the sensors alone will not bring the film back."""
        self._lag += self._nudged
        self._nudged = 0.0

    def forget_nudges(self) -> float:
        """Put the film to where the sensors alone have it; return by how much [K] it is warmer then than followed."""
        back, self._nudged = self._nudged, 0.0
        self._lag += back
        return -back

    def update(self, temperatures: NDArray[np.float32], step: float) -> float:
        """Return by how much [K] the film warmed over the last `step` [s], for the readings [degC] at its end."""
        readings: list[float] = temperatures.tolist()
        self.step = step
        self._age += step
        self._restless -= step
        if readings != self._last:  # always so while one is NaN
            self._last = readings
            self._take(readings, step)
        elif self._slope or self._prediction_variance:
            self._carry_on(step)
        if self._lag == 0.0:
            self.rate = 0.0
            return 0.0
        share = -math.expm1(-step / self.time_constant) if self.time_constant > 0 else 1.0
        change = share * self._lag
        self._lag -= change
        self._nudged -= share * self._nudged
        self.rate = change / step if step > 0.0 else 0.0
        if abs(self._lag) < SETTLED:
            self._lag = 0.0
        return change

    def _carry_on(self, step: float) -> None:
        """Move the chip's temperature along its slope; back to the last reading when a new one is overdue."""
        interval = min(self._interval, LONGEST_INTERVAL)
        if self._age <= OVERDUE * interval:
            change = self._slope * step
            self._carried += change
        else:
            change = -self._carried
            self._slope = self._carried = 0.0
            # Readings that do not change are foreseen without error.
            self._prediction_variance *= math.exp(-SLOPE_SHARE * step / interval)
            if self._prediction_variance < SETTLED * SETTLED:
                self._prediction_variance = 0.0
        self._chip += change
        self._lag += change

    def _take(self, readings: list[float], step: float) -> None:
        """Move the chip's temperature to new readings; keep the slope, and count what was not foreseen or not known."""
        known = [(index, value) for index, value in enumerate(readings) if math.isfinite(value)]
        if not known:
            self.told = math.nan
            self._unknown_variance += UNKNOWN_WANDER**2 * step if self._bias else 0.0
            self._slope = self._carried = 0.0
            return
        for index, value in known:
            self._bias.setdefault(index, value - self._chip)
        self.told = chip = sum(value - self._bias[index] for index, value in known) / len(known)
        # What the slope promised up to this scan: the part of the last step is not in it yet.
        error = chip - self._chip - self._slope * step
        if abs(error) > NOTICEABLE_ERROR or abs(self._slope) > NOTICEABLE_SLOPE:
            self._restless = RESTLESS * self.time_constant + 2.0 * min(self._age, LONGEST_INTERVAL)
        self._lag += chip - self._chip
        self._chip = chip
        self._carried = 0.0
        if self._unknown_variance or self._age > LONGEST_INTERVAL:
            self._unknown_variance = 0.0  # what was missed meanwhile is made up for at once
            self._slope = 0.0
        else:
            self._slope += SLOPE_SHARE * error / self._age
            self._prediction_variance += SLOPE_SHARE * (error * error - self._prediction_variance)
        self._interval, self._age = self._age, 0.0
