# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lag of the film's temperature behind the chip's sensors, of either sign, from the signal that untouched taxels share.

The film is its own thermometer: its charge is known to far less than a millikelvin, while a sensor reading has about 4
mK of noise. So the slower of the two is never differentiated: where the film is slower, the reading is delayed and
compared with the film; where the sensors are slower, the film's signal is delayed and compared with the reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.minima import golden_section
from posfet_model._lib.types import Array
from posfet_model.calibration.leaky_response import low_pass

LAGS: Final = (*(-np.geomspace(6.0, 0.02, 29)).tolist(), 0.0, *np.geomspace(0.02, 2.0, 25).tolist())
"""Lags of the film behind the sensors that are tried [s]; below 0: the sensors lag behind the film."""


@dataclass(frozen=True, eq=False)
class TemperatureFit:
    """Relation of the common-mode signal and the temperature of the chip's sensors."""

    lag: float
    """Lag of the film behind the sensors [s]; below 0: the sensors lag behind the film."""
    newton_per_kelvin: float
    """Common-mode signal per temperature [N/K]."""
    drift: float
    """Slope of the common-mode signal that is no temperature: an error of the offsets [N/s]."""
    residuals: Array
    """Reading minus that predicted from the film or the other way round [K], shape [blocks]."""

    @property
    def at_limit(self) -> bool:
        """Whether the best lag is the smallest or the largest that is tried."""
        return not LAGS[0] < self.lag < LAGS[-1]


def fit_temperature(time: Array, temperature: Array, common: Array, film_lag: float) -> TemperatureFit:
    """Fit the lag.

    Parameters
    ----------
    time : ndarray
        [s], shape [blocks].
    temperature : ndarray
        Reading of the chip's sensors, relative to its start [K], shape [blocks].
    common : ndarray
        Common-mode signal of the untouched taxels with the leakage compensated [N], shape [blocks].
    film_lag : float
        Lag of the film behind the chip [s], if the sensors lag even more.

    Returns
    -------
    TemperatureFit
        The lag with the smallest residuals.
    """

    def squares(lag: float) -> float:
        return float(np.square(_at(time, temperature, common, film_lag, lag).residuals).sum())

    best = int(np.argmin([squares(lag) for lag in LAGS]))
    at_limit = best in (0, len(LAGS) - 1)
    lag = LAGS[best] if at_limit else golden_section(squares, LAGS[best - 1], LAGS[best + 1], 20)
    return _at(time, temperature, common, film_lag, lag)


def _at(time: Array, temperature: Array, common: Array, film_lag: float, lag: float) -> TemperatureFit:
    """Return the fit for a given lag: ``film = a + b*t + p*temperature``, the faster one of the two delayed."""
    elapsed = time - time[0]
    columns = np.stack([np.ones(len(time)), elapsed, temperature], axis=1)
    if lag >= 0.0:
        columns[:, 2] = low_pass(time, temperature, lag)
        delayed = common - common[0]
    else:
        # The reading, which the sensors delay, is delayed like the film; all else is delayed like the reading.
        columns[:, :2] = low_pass(time, columns[:, :2], film_lag - lag)
        columns[:, 2] = low_pass(time, temperature, film_lag)
        delayed = low_pass(time, common, film_lag - lag)
    found = np.linalg.lstsq(columns, delayed, rcond=None)[0]
    per_kelvin = float(found[2])
    scale = per_kelvin if abs(per_kelvin) > 1e-9 else 1e-9
    return TemperatureFit(lag, per_kelvin, float(found[1]), (delayed - columns @ found) / scale)
