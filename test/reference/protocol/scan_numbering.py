# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sequence numbers of scans: which boot of the board a scan belongs to, how many are missing, which cannot be.

The sequence counts the ticks of the board's scan timer, so sequence and device time advance together. A number that
does not fit the time is used only when the next scan counts on from it: a counter that is frozen never does.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from posfet_driver.protocol.scan_codec import SEQUENCE
from reference.protocol.device_clock import DeviceClock
from reference.protocol.scan_assembler import ScanStatistics

LATE: Final = 64
"""Scans by which a frame may be late [1]; one that is further behind belongs to another boot. Assumed."""
TOLERANCE: Final = 0.5
"""Difference of sequence and time that fits after a long gap [scan periods]: half of what one missing scan makes."""
LATEST: Final = 0.99
"""The same after a short one [scan periods]: a busy board samples late, by less than a period. Assumed."""
RATE_TOLERANCE: Final = 0.02
"""The same for long gaps [1]; assumed."""
UNTIMED: Final = 16
"""Step of the sequence that fits while the board's clock stands still [1]."""
FASTEST: Final = 4.0
"""A sequence that runs this many times faster than all clocks is implausible [1]: the scan period may be unknown."""
SLACK: Final = 16.0
"""Scan periods by which it may run ahead besides [1]."""

_HALF: Final = (SEQUENCE + 1) // 2


class Number(NamedTuple):
    """What a board states of a scan."""

    boot: int
    """Number of the power-on, modulo 16."""
    low: int
    """Low 32 bits of the sequence."""
    reading: int
    """Device time as sent [us]."""


class ScanNumbering:
    """Owner of boot and sequence of a board's scans.

    Parameters
    ----------
    statistics : ScanStatistics
        Counts what is late, implausible or frozen.
    clock : DeviceClock
        The board's clock; it is read with each scan that is accepted.
    cautious : bool
        Whether a number that does not fit needs a successor. A classic header comes too seldom for that.
    """

    def __init__(self, statistics: ScanStatistics, clock: DeviceClock, cautious: bool) -> None:
        self.boot = -1
        """Number of the power-on of the newest scan; -1 before the first."""
        self.sequence = -1
        """Sequence of the newest scan, unwrapped; -1 before the first."""
        self.restarted = False
        """Whether the sequence began again with the newest scan; whoever has used it clears it."""
        self.period = 0.0
        """Scan period [us], as announced, or as measured where the scans contradict it."""
        self.announced = 0.0
        """Scan period [us], as announced."""
        self._statistics = statistics
        self._clock = clock
        self._cautious = cautious
        self._previous = (-1, -1)  # boot and last sequence before the newest restart
        self._candidate: Number | None = None  # does not fit; needs a successor
        self._open = True  # any sequence is possible
        self._gap_counts = True
        self._arrival = 0  # of the newest scan [ns]
        self._step = 0.0  # period by the newest candidate and its successor [us]
        self._set = 0.0  # scan period that was set, and not only stated [us]
        self._shortest = 0.0  # shortest one since the newest scan [us]
        self._earlier: tuple[float, ...] = ()  # other periods that ticks since the newest scan may have had

    def announce(self, period: float, confirmed: bool) -> bool:
        """Take a scan period that the board announces, in force from one of the ticks to come on.

        Parameters
        ----------
        period : float
            Scan period [us].
        confirmed : bool
            Whether it was set; what the board states unasked makes no jump of the sequence plausible.

        Returns
        -------
        bool
            Whether it is another one than announced before.
        """
        if confirmed:
            self._shortest = min(self._shortest, period) if self.boot >= 0 else period
            self._set = period
        if period == self.announced:
            return False
        if self.boot >= 0:
            periods = self.period, *self._earlier
            self._earlier = min(periods), max(periods)
        self.announced = self.period = period
        return True

    def open(self) -> None:
        """Accept any sequence next: the board was started, or may have been reset."""
        self._open = True

    def forget_gap(self) -> None:
        """Count no scan as missing before the next one: the board was stopped on request."""
        self._gap_counts = False

    def missing(self, number: Number, arrival: int) -> int | None:
        """Take the number of another scan, and return how many are missing before it.

        Parameters
        ----------
        number : Number
            What the board states.
        arrival : int
            Monotonic time of its arrival [ns].

        Returns
        -------
        int or None
            Number of missing scans; 0 when the sequence begins again, and -1 when the scan is the newest one.
            None when the scan is not to be used, which is counted.
        """
        same_boot, ahead = number.boot == self.boot, (number.low - self.sequence) & SEQUENCE
        if same_boot and ahead == 0:
            return -1
        if self._is_late(number):
            self._statistics.late += 1
            return None
        expected = self._expected(ahead, number.reading, arrival)
        if same_boot and self._fits(ahead, number.reading, expected):
            return self._advance(ahead, number.reading, expected, True, arrival)
        if self._cautious and self.boot >= 0 and not self._is_successor(number):
            self._candidate = number
            return None
        return self._jump(number, arrival)

    def begin_again(self, number: Number, arrival: int) -> int:
        """Take the number of a scan with which the sequence has begun again, as scans show that were sent before it.

        Parameters
        ----------
        number : Number
            What the board states.
        arrival : int
            Monotonic time of its arrival [ns].

        Returns
        -------
        int
            Number of missing scans: 0, as nobody knows.
        """
        return self._restart(number, arrival)

    def _is_late(self, number: Number) -> bool:
        """Return whether a scan was sent before one that was used, in this boot or the one before.

        What a board sends after it was started is not late: the sequence has begun again.
        """
        if number.boot == self.boot:
            return not self._open and (self.sequence - number.low) & SEQUENCE < LATE
        boot, last = self._previous
        return number.boot == boot and (number.low - last + LATE) & SEQUENCE < 2 * LATE

    def _jump(self, number: Number, arrival: int) -> int | None:
        """Take a number that does not fit the time."""
        same_boot, ahead = number.boot == self.boot, (number.low - self.sequence) & SEQUENCE
        elapsed = self._elapsed(number.reading, arrival)
        if same_boot and (ahead - SLACK) * self._shortest <= FASTEST * elapsed:
            return self._advance(ahead, number.reading, self._expected(ahead, number.reading, arrival), False, arrival)
        if same_boot and not self._cautious and not self._open:
            self._statistics.implausible += 1
            return None
        return self._restart(number, arrival)

    def _elapsed(self, reading: int, arrival: int) -> float:
        """Return the greatest time since the newest scan [us]: of the host, of the board while none is mapped."""
        age = self._clock.greatest_age(arrival)  # it may have waited to be read for as long as the host stood still
        return max((arrival - self._arrival) / 1000, self._clock.ahead(reading) if math.isnan(age) else age)

    def _fits(self, ahead: int, reading: int, expected: float) -> bool:
        """Return whether a step of the sequence fits the time that has passed on the board's clock."""
        clock = self._clock
        if clock.stalled or clock.ahead(reading) == 0:
            return ahead <= UNTIMED
        if ahead > UNTIMED and expected < (1 - RATE_TOLERANCE) * ahead * min((self.period, *self._earlier)):
            return False  # so much has not passed on the clock of the host
        late = clock.late + clock.elapsed(reading, expected) - expected  # against its tick, if the newest one is known
        most = max(LATEST * self.period, TOLERANCE * self.period + RATE_TOLERANCE * expected)
        return ahead < _HALF and abs(late) <= most

    def _expected(self, ahead: int, reading: int, arrival: int) -> float:
        """Return the time of a step of the sequence [us]; where the period has changed, the nearest to the reading.

        More than half a turn of the board's clock, in which any reading fits some number of turns, is expected only
        if so much has passed on the clock of the host.
        """
        expected = ahead * self.period
        if self._earlier and not self._clock.stalled and self._clock.ahead(reading) != 0:
            least, most = ahead * min(self.period, *self._earlier), ahead * max(self.period, *self._earlier)
            expected = min(max(self._clock.elapsed(reading, (least + most) / 2), least), most)
        half_turn = self._clock.half_turn
        return expected if expected <= half_turn else min(expected, max(self._elapsed(reading, arrival), half_turn))

    def _is_successor(self, number: Number) -> bool:
        """Return whether a number counts on from the candidate; two that do so alike measure the scan period."""
        candidate = self._candidate
        if candidate is None or candidate.boot != number.boot:
            return False
        step = (number.low - candidate.low) & SEQUENCE
        if step == 0:
            self._statistics.frozen_counter += number.reading != candidate.reading
            return False
        if step > UNTIMED:
            return False
        measured, before = self._clock.between(candidate.reading, number.reading) / step, self._step
        self._step = measured
        for period in (self.announced, before):
            if measured and abs(measured - period) <= RATE_TOLERANCE * period:
                self.period = period
                break
        return True

    def _advance(self, ahead: int, reading: int, expected: float, fits: bool, arrival: int) -> int:
        measured = [] if fits or not self._step else [self._step]
        slack = max(expected - ahead * min([self.period, *self._earlier, *measured]), 0.0)
        self._clock.advance(reading, expected, fits, arrival, self.period, slack)
        if self._open or ahead > UNTIMED:
            self._clock.interrupt(arrival)
        self._earlier, self._shortest = (), self._set
        self._arrival = arrival
        self.sequence += ahead
        counts, self._gap_counts, self._open, self._candidate = self._gap_counts, True, False, None
        return ahead - 1 if counts else 0

    def _restart(self, number: Number, arrival: int) -> int:
        if self.boot >= 0:
            self.restarted = True
            self._statistics.implausible += number.boot == self.boot and not self._open
        self._clock.restart(number.reading, number.boot == self.boot, arrival)
        self._earlier, self._shortest = (), self._set
        self._previous = self.boot, self.sequence
        self.boot, self.sequence, self._arrival = number.boot, number.low, arrival
        self._gap_counts, self._open, self._candidate = True, False, None
        return 0
