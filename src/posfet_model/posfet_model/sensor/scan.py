"""One scan of the array: what every board, real or simulated, hands to the model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

TEMPERATURE_SENSORS = 2
"""Temperature sensors on a chip (Dahiya et al., IEEE Sensors J. 11(12), 2011)."""

FULL_SCALE_COUNT = 0xFFFF
"""Count of the high end of the ADC's range; counts are on a 16-bit scale whatever the converter's resolution."""


class ScanStatus(IntFlag):
    """Status of the board and of a scan; the values are those of STATUS_* in posfet_msgs/TactileRaw."""

    OK = 0
    SUPPLY_LOW = 1
    ADC_FAULT = 2
    OVERTEMPERATURE = 4
    SCAN_OVERRUN = 8
    BOARD_RESET = 16
    TIME_ESTIMATED = 32


@dataclass(slots=True)
class Scan:
    """One complete scan. A source reuses the same object for every scan: `snapshot` returns a copy that stays."""

    stamp: int
    """Acquisition time [ns] since the Unix epoch."""
    layout_id: int
    sequence: int
    """Number of the scan since the board started; wraps of the wire's counter are undone."""
    device_time: int
    """The board's own clock at acquisition [us]; wraps are undone."""
    counts: NDArray[np.uint16]
    """ADC codes on a 16-bit scale, shape [rows * cols], row by row."""
    temperatures: NDArray[np.float32]
    """Chip temperature sensors [degC], shape [2]; NaN while not known."""
    status: int
    """Bits of ScanStatus."""
    frames_lost: int
    """CAN frames of this board lost since the driver started, whatever the cause."""

    @classmethod
    def empty(cls, layout_id: int, taxels: int) -> Scan:
        """Return a scan to be filled: counts 0, temperatures not known."""
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
