# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One scan of the array: the data that every board, real or simulated, passes to the model."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

TEMPERATURE_SENSORS = 2
"""Temperature sensors on a chip (Dahiya et al., IEEE Sensors J. 11(12), 2011)."""

FULL_SCALE_COUNT = 0xFFFF
"""Count at the upper end of the ADC's range; counts are on a 16-bit scale whatever the ADC's resolution."""


class ScanStatus(IntFlag):
    """Status of the board and of a scan; the values are those of STATUS_* in posfet_msgs/TactileRaw."""

    OK = 0
    SUPPLY_LOW = 1
    ADC_FAULT = 2
    OVERTEMPERATURE = 4
    SCAN_OVERRUN = 8
    BOARD_RESET = 16
    TIME_ESTIMATED = 32
    SEQUENCE_ESTIMATED = 64
    CHARGE_RESET = 128


@dataclass(slots=True)
class Scan:
    """One complete scan. A source reuses the same object for every scan: `snapshot` returns a copy that stays."""

    stamp: int
    """Acquisition time [ns] since the Unix epoch."""
    layout_id: int
    sequence: int
    """Sequence number since the board started; the counter of the CAN protocol is unwrapped."""
    device_time: int
    """The board's clock at acquisition [us], unwrapped."""
    counts: NDArray[np.uint16]
    """ADC codes on a 16-bit scale, shape [rows * cols], row by row."""
    temperatures: NDArray[np.float32]
    """Chip temperature sensors [degC], shape [2]; NaN while unknown."""
    status: int
    """Bits of ScanStatus."""
    frames_lost: int
    """CAN frames of this board lost since the driver started, for any reason."""
    stamp_uncertainty: float = math.nan
    """Largest error of the stamp [s], besides the delay that all frames have in common; NaN: unknown."""

    @classmethod
    def empty(cls, layout_id: int, taxels: int) -> Scan:
        """Return a scan to be filled in: counts 0, temperatures unknown (NaN).

        Parameters
        ----------
        layout_id : int
            Identifier of the layout.
        taxels : int
            Number of taxels.
        """
        return cls(
            stamp=0,
            layout_id=layout_id,
            sequence=0,
            device_time=0,
            counts=np.zeros(taxels, np.uint16),
            temperatures=np.full(TEMPERATURE_SENSORS, np.nan, np.float32),
            status=ScanStatus.OK,
            frames_lost=0,
        )

    def snapshot(self) -> Scan:
        """Return an independent copy, which the next scan does not overwrite."""
        return replace(self, counts=self.counts.copy(), temperatures=self.temperatures.copy())
