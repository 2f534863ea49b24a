# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lag of the film's temperature behind the chip's sensors, of either sign, from the signal that untouched taxels share.

The film is its own thermometer: its charge is known to far less than a millikelvin, while a sensor reading has about 4
mK of noise. So the slower of the two is never differentiated: where the film is slower, the reading is delayed and
compared with the film; where the sensors are slower, the film's signal is delayed and compared with the reading. A part
of that delay may be a dead time: heat that diffuses to a sensor arrives late, and then at once.

Leakage depends on the temperature. The common-mode signal F was compensated with the time constants tau of the
presses, at the temperature T0. Where the leak rates are higher by a share of a*(T - T0), that left out as much of what
leaked: F falls behind the film's charge by a times the integral of (T - T0)*q/tau, where the charge q at the gate is
the high-pass of F. That integral is quadratic in the temperature, which tells it from the pyroelectric charge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from posfet_model._lib.minima import golden_section
from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.leaky_response import high_pass, low_pass
from posfet_model.calibration.response_fit import BLOCK

LAGS: Final = (*(-np.geomspace(6.0, 0.02, 29)).tolist(), 0.0, *np.geomspace(0.02, 2.0, 25).tolist())
"""Lags of the film behind the sensors that are tried [s]; below 0: the sensors lag behind the film."""


DEAD_SHARES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the sensors' lag that are tried as a dead time [1]; the rest is of first order."""

ROUNDS: Final = 3
"""Rounds in which the film's temperature and what leaks by it are found in turn."""


@dataclass(frozen=True, eq=False)
class TemperatureFit:
    """Relation of the common-mode signal and the temperature of the chip's sensors."""

    lag: float
    """Lag of the film behind the sensors [s]; below 0: the sensors lag behind the film."""
    newton_per_kelvin: float
    """Common-mode signal per temperature [N/K]."""
    drift: float
    """Slope of the common-mode signal that is no temperature: an error of the offsets [N/s]."""
    leak_per_kelvin: float
    """Increase of the leak rates per temperature, relative to those of the presses [1/K], and"""
    leak_per_kelvin_deviation: float
    """its standard deviation [1/K]."""
    dead_share: float
    """Share of the sensors' lag that is a dead time [1]."""
    residuals: Array
    """Reading minus that predicted from the film or the other way round [K], shape [blocks]."""

    @property
    def reading_deviation(self) -> float:
        """Standard deviation of a reading: noise and rounding [K]."""
        # From differences over a second, in which all else is small. Readings are interpolated, which leaves two thirds
        # of their variance. Less is found of what does not change within a second, as the rounding of a constant
        # temperature, and where the film lags behind the sensors, as readings are delayed like it then.
        second = round(1.0 / BLOCK)
        changes = self.residuals[second:] - self.residuals[:-second]
        return math.sqrt(0.75 * float(np.mean(np.square(changes)))) if len(changes) else 0.0

    @property
    def at_limit(self) -> bool:
        """Whether the best lag is the smallest or the largest that is tried."""
        return not LAGS[0] < self.lag < LAGS[-1]


LEAK_UNCERTAINTY: Final = 5e-3
"""Standard deviation of what leak rates increase by per temperature, besides that of the fit [1/K], assumed: a
pyroelectric coefficient that changes with temperature looks the same, and so does 1/f noise over these seconds."""


def fit_temperature(
    time: Array,
    temperature: Array,
    common: Array,
    changing: Mask,
    film_lag: float,
    pressed: float,
    time_constant: float,
) -> TemperatureFit:
    """Fit the lag.

    Parameters
    ----------
    time : ndarray
        [s], shape [blocks].
    temperature : ndarray
        Reading of the chip's sensors, relative to its start [K], shape [blocks].
    common : ndarray
        Common-mode signal of the untouched taxels with the leakage compensated [N], shape [blocks].
    changing : ndarray of bool
        The blocks in which the temperature changes, one after another, and nothing touches: these tell the leakage, as
        what a press leaves in the common-mode signal looks like it, shape [blocks].
    film_lag : float
        Lag of the film behind the chip [s], if the sensors lag even more.
    pressed : float
        Temperature of the presses, relative to the start [K].
    time_constant : float
        Time constant tau of the leakage then [s].

    Returns
    -------
    TemperatureFit
        The lag with the smallest residuals.
    """
    charge = high_pass(time, common, time_constant) / time_constant
    nothing, unseen = np.zeros(len(time)), np.zeros(len(time))
    without_dead_time: dict[float, float] = {}
    shares = [_best(time, temperature, common, nothing, film_lag, share, without_dead_time) for share in DEAD_SHARES]
    share = min(shares, key=lambda each: float(np.square(each.residuals).sum())).dead_share
    parts = time[changing], temperature[changing], common[changing]
    found = _best(*parts, nothing[changing], film_lag, share)
    start = temperature[changing][0] - common[changing][0] / found.newton_per_kelvin
    for _ in range(ROUNDS):
        # The film is its own thermometer, which the sensors lag behind.
        film = start + (common + found.leak_per_kelvin * unseen) / found.newton_per_kelvin
        leaking = (film - pressed) * charge
        unseen = np.concatenate([[0.0], np.cumsum(0.5 * (leaking[1:] + leaking[:-1]) * np.diff(time))])
        found = _best(*parts, unseen[changing], film_lag, share)
    # Charge leaks faster the warmer it is: less than the deviation is something else.
    leak = found.leak_per_kelvin if found.leak_per_kelvin > found.leak_per_kelvin_deviation else 0.0
    whole = _best(time, temperature, common + leak * unseen, nothing, film_lag, share)
    return replace(whole, leak_per_kelvin=leak, leak_per_kelvin_deviation=found.leak_per_kelvin_deviation)


def _best(
    time: Array,
    temperature: Array,
    common: Array,
    unseen: Array,
    film_lag: float,
    dead_share: float,
    without_dead_time: dict[float, float] | None = None,
) -> TemperatureFit:
    """Return the fit with the lag that leaves the smallest residuals.

    `without_dead_time` keeps the squares of the lags from 0 for searches with another share of the same signals.
    """
    known = {} if without_dead_time is None else without_dead_time

    def at(lag: float) -> _Solution:
        return _solve(time, temperature, common, unseen, film_lag, lag, dead_share)

    def squares(lag: float) -> float:
        if lag < 0.0:
            return at(lag).squares
        if lag not in known:
            known[lag] = at(lag).squares
        return known[lag]

    best = int(np.argmin([squares(lag) for lag in LAGS]))
    at_limit = best in (0, len(LAGS) - 1)
    lag = LAGS[best] if at_limit else golden_section(squares, LAGS[best - 1], LAGS[best + 1], 20)
    return at(lag).fit()


@dataclass(frozen=True, eq=False)
class _Solution:
    """Least squares for a given lag, without the uncertainty, which takes as long and is asked for once per search."""

    lag: float
    dead_share: float
    columns: Array
    coefficients: Array
    left: Array
    """What the columns leave of the common-mode signal [N], shape [blocks]."""

    @property
    def scale(self) -> float:
        """Response of the film to its temperature [N/K], or the least that divides."""
        per_kelvin = float(self.coefficients[3])
        return per_kelvin if abs(per_kelvin) > 1e-9 else 1e-9

    @property
    def squares(self) -> float:
        """Sum of the squared residuals [K2]."""
        return float(np.square(self.left / self.scale).sum())

    def fit(self) -> TemperatureFit:
        """Return the fit with its uncertainty."""
        _, drift, leak, per_kelvin = map(float, self.coefficients)
        columns, left = self.columns, self.left
        spread = np.linalg.pinv(columns.T @ columns)[2, 2] * float(left @ left) / max(len(left) - 4, 1)
        deviation = math.hypot(math.sqrt(spread), LEAK_UNCERTAINTY)
        return TemperatureFit(self.lag, per_kelvin, drift, leak, deviation, self.dead_share, left / self.scale)


def _solve(
    time: Array, temperature: Array, common: Array, unseen: Array, film_lag: float, lag: float, dead_share: float
) -> _Solution:
    """Return the solution for a given lag: ``film = a + b*t - c*unseen + p*temperature``, the faster one delayed."""
    elapsed, temperature = time - time[0], temperature - temperature[0]
    columns = np.stack([np.ones(len(time)), elapsed, -unseen, temperature], axis=1)
    if lag >= 0.0:
        columns[:, 3] = low_pass(time, temperature, lag)
        delayed, dead_share = common - common[0], 0.0
    else:
        # The reading, which the sensors delay, is delayed like the film; all else is delayed like the reading.
        dead = dead_share * (film_lag - lag)
        slow = film_lag - lag - dead
        columns[:, :3] = low_pass(time, _after(time, columns[:, :3], dead), slow)
        columns[:, 3] = low_pass(time, temperature, film_lag)
        delayed = low_pass(time, _after(time, common[:, None], dead)[:, 0], slow)
    coefficients = np.linalg.lstsq(columns, delayed, rcond=None)[0]
    return _Solution(lag, dead_share, columns, coefficients, delayed - columns @ coefficients)


def _after(time: Array, columns: Array, dead: float) -> Array:
    """Return columns a dead time [s] later, shape [blocks, columns]."""
    return np.stack([np.interp(time - dead, time, column) for column in columns.T], axis=1)
