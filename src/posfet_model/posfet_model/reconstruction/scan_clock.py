"""Which scans to take, and the time that passed between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

LONGEST_GAP: Final = 2.0
"""Longest interval in which the force is followed, in time constants of the leak; beyond, little of it is left [1]."""

JUMP_FACTOR: Final = 4.0
"""An interval this many times longer than the scans missed explain is a jump of the clock [1]."""

JUMP_LEAST: Final = 0.02
"""Shortest difference that counts as a jump of the clock [s]."""

PERIOD_GAIN: Final = 0.01
"""Share of each interval by the board's clock that the period learns [1]."""

ESTIMATED_GAIN: Final = 0.001
"""The same for times of arrival, whose jitter has to average out [1]."""

MOST_LATE: Final = 10
"""After this many late scans in a row the board is taken to have begun anew."""

# Plain numbers: each `&` with a flag of an enumeration costs as much as a call into NumPy.
_ADC_FAULT: Final = int(ScanStatus.ADC_FAULT)
_BOARD_RESET: Final = int(ScanStatus.BOARD_RESET)
_TIME_ESTIMATED: Final = int(ScanStatus.TIME_ESTIMATED)


@dataclass
class ScanCounts:
    """Scans counted by what became of them."""

    accepted: int = 0
    layout_mismatch: int = 0
    """Refused: another layout, or not as many counts as the layout has taxels."""
    repeated: int = 0
    """Refused: the scan had been there already."""
    late: int = 0
    """Refused: older than one that was taken."""
    adc_fault: int = 0
    """Refused: the board reports a fault of its ADC."""
    implausible: int = 0
    """Refused: most taxels at the end of their range at once."""
    missed: int = 0
    """Never came: gaps of the sequence. The force is followed across them."""
    resets: int = 0
    """The board began anew; the interval is taken from the stamps."""
    time_jumps: int = 0
    """The board's clock jumped; the interval is taken from the sequence."""
    gaps: int = 0
    """Interruptions: an interval too long to follow the force."""

    def snapshot(self) -> ScanCounts:
        """Return an independent copy, which later scans do not change."""
        return replace(self)


class ScanClock:
    """Admits scans one by one; `step` and `interrupted` then tell about the interval before the last one admitted."""

    def __init__(self, sensor: Sensor) -> None:
        self._layout_id = sensor.layout.id
        self._shape = (sensor.layout.taxels,)
        self._longest = LONGEST_GAP * sensor.device.leak_time_constant
        self._period = 1.0 / sensor.can.scan_rate
        self._periods = self._period / JUMP_FACTOR, self._period * JUMP_FACTOR
        self._late_in_a_row = 0
        self._sequence = -1
        self._device_time = 0
        self._stamp = 0
        self._estimated = True
        self._arrivals = 0
        self.counts = ScanCounts()
        self.step = self._period
        """Interval [s] before the scan."""
        self.interrupted = False
        """Whether the interval is not known, or too long."""
        self.suspect = False
        """Whether the interval had to be guessed."""

    def fits(self, scan: Scan) -> bool:
        """Return whether a scan is one of this sensor, fit to be looked at."""
        if scan.layout_id != self._layout_id or scan.counts.shape != self._shape:
            self.counts.layout_mismatch += 1
            return False
        if scan.status & _ADC_FAULT:
            self.counts.adc_fault += 1
            return False
        return True

    def admit(self, scan: Scan) -> bool:
        """Return whether to take a scan that fits."""
        self.interrupted = self.suspect = False
        ahead = scan.sequence - self._sequence
        if self._sequence < 0:
            self.step = self._period
        elif scan.status & _BOARD_RESET:
            self._reset(scan)
        elif ahead == 0:
            self.counts.repeated += 1
            return False
        elif ahead < 0:
            self._late_in_a_row += 1
            if scan.stamp <= self._stamp and self._late_in_a_row <= MOST_LATE:
                self.counts.late += 1
                return False
            self._reset(scan)
        else:
            self._measure(scan, ahead)
        self._sequence = scan.sequence
        self._device_time = scan.device_time
        self._stamp = scan.stamp
        self._estimated = bool(scan.status & _TIME_ESTIMATED)
        self._late_in_a_row = 0
        self.counts.accepted += 1
        return True

    def _reset(self, scan: Scan) -> None:
        """Bridge a restart of the board by the stamps, which go on."""
        self.counts.resets += 1
        self.suspect = True
        self._bridge((scan.stamp - self._stamp) * 1e-9)

    def _bridge(self, interval: float) -> None:
        """Set the interval; one out of range interrupts the force."""
        self.interrupted = not 0.0 < interval <= self._longest
        self.step = self._period if self.interrupted else interval

    def _measure(self, scan: Scan, ahead: int) -> None:
        """Find the interval before a scan that is `ahead` in sequence of the last one."""
        self.counts.missed += ahead - 1
        expected = ahead * self._period
        estimated = self._estimated or scan.status & _TIME_ESTIMATED
        ticks = (scan.stamp - self._stamp) * 1e-9 if estimated else (scan.device_time - self._device_time) * 1e-6
        late = ticks - expected > JUMP_LEAST and ticks > JUMP_FACTOR * expected
        if late or ticks < 0.0 or (ticks == 0.0 and not estimated):
            self.counts.time_jumps += 1
            self.suspect = True
            ticks = expected
        elif estimated:
            # Times of arrival jitter, and come in bursts; the board itself scans evenly.
            self._arrivals += 1
            self._learn(ticks / ahead, max(1.0 / self._arrivals, ESTIMATED_GAIN))
            ticks = ahead * self._period
        elif ahead == 1:
            self._learn(ticks, PERIOD_GAIN)
        self._bridge(ticks)
        self.counts.gaps += self.interrupted

    def _learn(self, interval: float, gain: float) -> None:
        """Let the period follow an interval [s], within what a board of this sensor can be set to."""
        period = self._period + gain * (interval - self._period)
        shortest, longest = self._periods
        self._period = shortest if period < shortest else longest if period > longest else period

    @property
    def rate(self) -> float:
        """Scans per second by the board's clock [Hz]."""
        return 1.0 / self._period if self._period > 0 else math.nan
