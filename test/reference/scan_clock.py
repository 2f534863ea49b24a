# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the admission of scans, and of the time interval between them."""

from __future__ import annotations

import math
from typing import Final

from posfet_model.reconstruction.scan_clock import ScanCounts
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

LONGEST_GAP: Final = 2.0
"""Longest interval across which the force is tracked, in time constants of the leakage [1]; after a longer one little
charge is left."""

CLOSE: Final = 4
"""Greatest step of the sequence to a scan that closely follows the one before [1], assumed: until then little charge
leaks, and no more scans than that are refused in a row for bursts."""

JUMP_FACTOR: Final = 4.0
"""An interval this many times longer than the missing scans explain is a clock jump [1]."""

JUMP_LEAST: Final = 0.02
"""Least difference that counts as a clock jump [s]."""

SAME_INTERVAL: Final = 0.1
"""Relative difference up to which two such intervals in a row are the same [1]: the board was set to a lower rate."""

PERIOD_GAIN: Final = 0.01
"""Gain of an interval by the board clock in the estimate of the period [1]."""

ESTIMATED_GAIN: Final = 0.001
"""The same for arrival times, whose jitter must be averaged [1]."""

MOST_LATE: Final = 10
"""Number of consecutive late scans after which the board is assumed to have restarted."""

# Plain integers: each `&` with a flag of an enumeration costs as much as a call into NumPy.
_ADC_FAULT: Final = int(ScanStatus.ADC_FAULT)
_BOARD_RESET: Final = int(ScanStatus.BOARD_RESET)
_CHARGE_RESET: Final = int(ScanStatus.CHARGE_RESET)
_RESTART: Final = _BOARD_RESET | _CHARGE_RESET
_TIME_ESTIMATED: Final = int(ScanStatus.TIME_ESTIMATED)


class ScanClock:
    """Admits scans one by one; `step` and `interrupted` describe the interval before the last admitted one.

    State variables: estimated period of the scans [s]; sequence, device time [us] and stamp [ns] of the last scan.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        self._layout_id = sensor.layout.id
        self._shape = (sensor.layout.taxels,)
        self._longest = LONGEST_GAP * sensor.device.leak_time_constant
        self._period = 1.0 / sensor.can.scan_rate
        self._shortest, self._longest_period, self._odd = self._period / JUMP_FACTOR, self._period * JUMP_FACTOR, 0.0
        self._late_in_a_row = 0
        self._refused, self._newest_refused = 0, 0  # scans since the last admitted one, by their content
        self._restart = 0  # flags of restarts since the last admitted scan, also of scans that were refused
        self._restarted = 0  # stamp of the newest scan with such a flag [ns]
        self._sequence = -1
        self._device_time = 0
        self._stamp = 0
        self._estimated = True
        self._arrivals = 0
        self.counts = ScanCounts()
        """Numbers of scans and events."""
        self.step = self._period
        """Interval before the scan [s], > 0."""
        self.interrupted = False
        """Whether the interval is unknown, or too long to track the force."""
        self.close = False
        """Whether at most a few scans were lost or refused since the one before: charge has hardly leaked."""
        self.suspect = False
        """Whether the interval was derived from the sequence or the stamps for lack of a valid device time."""

    def fits(self, scan: Scan) -> bool:
        """Return whether a scan has the layout of this sensor; count it otherwise."""
        if scan.layout_id == self._layout_id and scan.status & _RESTART:
            self._note_restart(scan)
        if scan.layout_id == self._layout_id and scan.counts.shape == self._shape:
            return True
        self.counts.layout_mismatch += 1
        return False

    def is_new(self, scan: Scan) -> bool:
        """Return whether a scan that fits is neither duplicate nor late; count it otherwise."""
        ahead = scan.sequence - self._sequence
        if self._sequence < 0:
            return True
        if self._restart:
            is_later = scan.stamp >= self._restarted
        elif ahead == 0:
            self.counts.repeated += 1
            return False
        else:
            is_later = ahead > 0 or scan.stamp > self._stamp  # the sequence has restarted
        if is_later:
            return True
        self._late_in_a_row += 1
        if self._late_in_a_row > MOST_LATE:
            return True
        self.counts.late += 1
        return False

    def is_sound(self, scan: Scan) -> bool:
        """Return whether the board reports no ADC fault; count it otherwise."""
        if scan.status & _ADC_FAULT:
            self.counts.adc_fault += 1
            return False
        return True

    def refuse(self, scan: Scan) -> None:
        """Note a scan that is new, and refused for its content: it is not missing."""
        newest = self._newest_refused if self._refused else self._sequence
        if scan.layout_id == self._layout_id and scan.sequence > newest:
            self._newest_refused = scan.sequence
            self._refused += 1

    def admit(self, scan: Scan) -> None:
        """Accept a scan that fits, is new and sound; set the interval before it."""
        self.interrupted = self.suspect = False
        ahead = scan.sequence - self._sequence
        self.close = 0 < ahead <= CLOSE and self._sequence >= 0 and not self._restart
        if self._sequence < 0:
            self.step = self._period
        elif self._restart & _BOARD_RESET or ahead <= 0:
            self._reset(scan)
        else:
            self._measure(scan, ahead)
        self._sequence = scan.sequence
        self._device_time = scan.device_time
        self._stamp = scan.stamp
        self._estimated = bool(scan.status & _TIME_ESTIMATED)
        self._late_in_a_row = self._restart = self._refused = 0
        self.counts.accepted += 1

    def _note_restart(self, scan: Scan) -> None:
        """Note that the board has restarted before a scan, unless that is the last admitted one once more."""
        if scan.sequence != self._sequence or scan.stamp != self._stamp:
            self._restart |= scan.status & _RESTART
            self._restarted = scan.stamp

    def _reset(self, scan: Scan) -> None:
        """Bridge a restart of the board by the stamps, which continue."""
        self.counts.resets += 1
        self.suspect, self._odd = True, 0.0
        self._bridge((scan.stamp - self._stamp) * 1e-9)

    def _bridge(self, interval: float) -> None:
        """Set the interval [s]; one out of range interrupts the force, and so does a charge that began anew."""
        self.interrupted = bool(self._restart & _CHARGE_RESET) or not 0.0 < interval <= self._longest
        self.step = self._period if self.interrupted else interval
        self.counts.gaps += self.interrupted

    def _measure(self, scan: Scan, ahead: int) -> None:
        """Measure the interval before a scan that is `ahead` of the last one in sequence."""
        self.counts.missed += max(ahead - 1 - self._refused, 0)
        expected = ahead * self._period
        estimated = self._estimated or scan.status & _TIME_ESTIMATED
        arrived = (scan.stamp - self._stamp) * 1e-9
        interval = arrived if estimated else (scan.device_time - self._device_time) * 1e-6
        each = interval / ahead
        late = interval - expected > JUMP_LEAST and interval > JUMP_FACTOR * expected
        repeats = abs(each - self._odd) < SAME_INTERVAL * self._odd and abs(arrived - interval) < 0.5 * interval
        if late and repeats and not estimated:  # the board was set to a lower rate
            self._period, late = each, False
            self._longest_period = max(self._longest_period, each)
        self._odd = each if late else 0.0
        if late or interval < 0.0 or (interval == 0.0 and not estimated):
            self.counts.time_jumps += 1
            self.suspect = True
            interval = expected
        elif estimated:
            # Arrival times have jitter, and come in bursts; the board itself scans at a constant rate.
            self._arrivals += 1
            self._update_period(each, max(1.0 / self._arrivals, ESTIMATED_GAIN))
            self._period = min(max(self._period, self._shortest), self._longest_period)
            interval = ahead * self._period
        elif ahead == 1:
            self._update_period(interval, PERIOD_GAIN)
        self._bridge(interval)

    def _update_period(self, interval: float, gain: float) -> None:
        """Update the period by an interval [s]."""
        self._period += gain * (interval - self._period)

    @property
    def rate(self) -> float:
        """Scans per second by the board clock [Hz]."""
        return 1.0 / self._period if self._period > 0 else math.nan
