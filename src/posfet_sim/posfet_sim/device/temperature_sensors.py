# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Readings of the temperature sensors on the chip, with their lag and offset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.scan import TEMPERATURE_SENSORS
from posfet_sim.device.board_effects import BoardEffects, Draw
from posfet_sim.device.random_streams import Stream, generator

NEGLIGIBLE_LAG: Final = 1e-6
"""Lag that counts as none [K]: below the resolution of the readings."""


class TemperatureSensors:
    """First-order lag of all sensors behind the chip temperature, and a constant offset of each.

    The chip temperature is linear between scans, for which the lag l is exact:
    ``l1 = l0 + (slope*tau - l0)*(1 - exp(-h/tau))``. It starts settled.

    Parameters
    ----------
    effects : BoardEffects
        Lag, and standard deviation of the offsets.
    chip : float
        Chip temperature at the start [degC].
    seed : int
        Seed of the board.
    """

    def __init__(self, effects: BoardEffects, chip: float, seed: int) -> None:
        self.lag = 0.0
        """Chip temperature minus that of the sensors at the last scan [K]."""
        self.time_constant = effects.sensor_lag
        """Time constant of the lag [s]."""
        random = generator(seed, Stream.BOARD, Draw.TEMPERATURE_SENSORS)
        self.offsets: NDArray[np.float64] | None = (
            effects.sensor_offset * random.standard_normal(TEMPERATURE_SENSORS) if effects.sensor_offset else None
        )
        """Constant error of each sensor [K]; None without errors."""
        self._chip = chip

    def advance(self, chip: Sequence[float], steps: NDArray[np.float64]) -> list[float]:
        """Return the temperature of the sensors at several scans, without their offsets [degC].

        Parameters
        ----------
        chip : sequence of float
            Chip temperature at each scan [degC].
        steps : numpy.ndarray
            Interval since the previous scan [s], shape [scans].

        Returns
        -------
        list of float
            Temperature at each scan [degC].
        """
        tau, before, behind = self.time_constant, self._chip, self.lag
        if tau == 0 or (behind == 0 and all(each == before for each in chip)):
            self._chip = chip[-1]
            return list(chip)
        sensed = []
        for each, step in zip(chip, steps.tolist(), strict=True):
            behind -= math.expm1(-step / tau) * ((each - before) * tau / step - behind)
            if each == before and abs(behind) < NEGLIGIBLE_LAG:
                behind = 0.0
            sensed.append(each - behind)
            before = each
        self._chip, self.lag = before, behind
        return sensed
