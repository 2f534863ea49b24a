# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Admission of scans, and the time interval between them.

Compiled: `posfet_core`, scan_clock.hpp.
"""

from __future__ import annotations

from dataclasses import dataclass

from posfet_core import scan_path
from posfet_model.sensor.description import Sensor


@dataclass
class ScanCounts:
    """Numbers of scans and events since the start, by cause."""

    accepted: int = 0
    """Scans accepted."""
    layout_mismatch: int = 0
    """Refused: wrong layout, or number of counts other than the number of taxels."""
    repeated: int = 0
    """Refused: duplicate."""
    late: int = 0
    """Refused: older than a scan that was accepted."""
    adc_fault: int = 0
    """Refused: the board reports an ADC fault."""
    implausible: int = 0
    """Refused: most taxels saturated at once."""
    bursts: int = 0
    """Refused: interference in a single scan, which no touch can have caused."""
    missed: int = 0
    """Missing scans: gaps of the sequence, but for scans that were refused for their content. The force is tracked
    across them."""
    resets: int = 0
    """Restarts of the board; the interval is taken from the stamps."""
    time_jumps: int = 0
    """Jumps of the board clock; the interval is taken from the sequence."""
    gaps: int = 0
    """Interruptions: intervals too long to track the force, and resets after which the charge is another one."""


class ScanClock(scan_path.ScanClock):
    """Admits scans one by one; `step` and `interrupted` describe the interval before the last admitted one.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        layout = sensor.layout
        super().__init__(layout.id, layout.taxels, sensor.device.leak_time_constant, sensor.can.scan_rate)

    @property
    def counts(self) -> ScanCounts:
        """Numbers of scans and events, as they are now."""
        return ScanCounts(*self.count_values)

    @property
    def rate(self) -> float:
        """Scans per second by the board clock [Hz]."""
        return 1.0 / self.period
