# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The clock of a board: device time without wraps, jumps and stand-stills."""

from __future__ import annotations

from typing import Final

from reference.protocol.clock_sync import ClockSync

FROZEN_READINGS: Final = 3
"""Consecutive repetitions of a device time from which on the clock is reported as frozen: a scan may be sampled at the
time of the one before."""
EARLIEST: Final = -1e6
PROMPT: Final = 5e6
"""Delays of a frame [ns] by which its reading is right though the sequence contradicts it, the latter besides the
delay by the sequence; assumed."""
LATEST: Final = 100e6
"""Delay of a frame [ns] up to which the clock has gone on though the sequence began again; assumed."""


class DeviceClock:
    """Unwraps the device time of a board.

    A reading that repeats the one before is no time of a later scan: the time is counted on by the sequence. Where
    reading and sequence contradict each other, one of them has jumped, and the arrival decides. The reading is right if
    the frame arrived after it, and not much later than by the sequence; else that of the two by which the frame is less
    delayed. So the time goes on evenly, and the mapping of the clock with it; by how much it may be ahead if the other
    one was right, the mapping is told.

    A scan is sampled at its tick or later, and never earlier. What is counted on by the sequence is therefore counted
    from the tick of the newest reading, not from the reading.

    Parameters
    ----------
    bits : int
        Number of bits of a reading.
    sync : ClockSync
        Mapping of this clock; it is reset when the clock starts again.
    """

    def __init__(self, bits: int, sync: ClockSync) -> None:
        self.time = 0
        """Device time of the newest scan, unwrapped [us]."""
        self.repeated = 0
        """Readings that repeat the one before while the clock is frozen; never falls."""
        self._modulus = 1 << bits
        self._sync = sync
        self._reading = 0  # newest, as sent [us]
        self._read_time = 0  # `time` when the reading changed last [us]
        self._late = 0.0  # of the newest reading against its tick [us]
        self._counted = 0.0  # time since then, by the sequence [us]
        self._in_a_row = 0
        self._known = False

    @property
    def late(self) -> float:
        """Time by which the newest reading was taken late, as far as is known [us]."""
        return self._late

    @property
    def stalled(self) -> bool:
        """Whether the newest reading repeats the one before: `time` is computed from the sequence."""
        return self._in_a_row > 0

    @property
    def frozen(self) -> bool:
        """Whether the clock stands still while scans go on."""
        return self._in_a_row >= FROZEN_READINGS

    @property
    def half_turn(self) -> int:
        """Time in which the readings wrap by half [us]: what is longer, they do not tell alone."""
        return self._modulus // 2

    def between(self, earlier: int, later: int) -> int:
        """Return the time from one reading to another, modulo the range of readings [us]."""
        return (later - earlier) % self._modulus

    def ahead(self, reading: int) -> int:
        """Return how far a reading is ahead of the newest one, modulo the range of readings [us]; 0 if unknown."""
        return (reading - self._reading) % self._modulus if self._known else 0

    def greatest_age(self, arrival: int) -> float:
        """Return the greatest time since the newest scan was acquired [us]; NaN before the first.

        Parameters
        ----------
        arrival : int
            Present monotonic time [ns].
        """
        return (self._sync.delay(self.time, arrival) + self._sync.excess) / 1000

    def elapsed(self, reading: int, expected: float) -> int:
        """Return the time since the newest reading [us].

        Parameters
        ----------
        reading : int
            Device time as sent [us].
        expected : float
            The same by the sequence [us]: it tells how often the clock has wrapped meanwhile.
        """
        elapsed = (reading - self._reading) % self._modulus
        if expected > self._modulus // 2:
            elapsed += max(round((expected - elapsed) / self._modulus), 0) * self._modulus
        return elapsed

    def advance(
        self, reading: int, expected: float, fits: bool, arrival: int, period: float, slack: float = 0.0
    ) -> None:
        """Take a reading of a later scan.

        Parameters
        ----------
        reading : int
            Device time as sent [us].
        expected : float
            Time since the previous reading by the sequence [us].
        fits : bool
            Whether the two agree.
        arrival : int
            Monotonic time at which the scan arrived [ns].
        period : float
            Scan period [us]: a scan is sampled late by less.
        slack : float, default 0
            Time by which `expected` may be too long, as the scan period is not known [us].
        """
        counted = self._counted + expected
        elapsed = (reading - self._reading) % self._modulus
        if slack and self._sync.delay(self._read_time + elapsed, arrival) < EARLIEST:
            fits = False  # the longest of several periods is not that of the board: the time is of the future
        if elapsed and fits and not self._in_a_row and expected < self._modulus // 2:  # as nearly always
            late = self._late + elapsed - expected
            self._late = late if 0.0 < late < period else 0.0
            self._reading = reading
            self.time = self._read_time = self._read_time + elapsed
            return
        elapsed = self.elapsed(reading, counted)
        if elapsed == 0:
            self._repeat(counted, expected <= period, arrival)
            return
        time = self._read_time + elapsed
        if self._in_a_row or not fits:
            time = self._decide(time, self._count_on(counted), arrival, slack)
        self._take(reading, time)

    def restart(self, reading: int, same_boot: bool, arrival: int) -> None:
        """Take the reading of a scan with which the sequence began again.

        Parameters
        ----------
        reading : int
            Device time as sent [us].
        same_boot : bool
            Whether the number of the power-on is the same: then the clock may have gone on.
        arrival : int
            Monotonic time at which the scan arrived [ns].
        """
        went_on = self._read_time + self.ahead(reading)
        if same_boot and self._known and EARLIEST <= self._sync.delay(went_on, arrival) <= LATEST:
            self._sync.doubt(went_on, arrival)
            self._take(reading, went_on)
            return
        self._known = True
        self._sync.reset()
        self._take(reading, reading)

    def interrupt(self, arrival: int) -> None:
        """Note that the board may have been reset before the newest reading, whatever it states.

        Parameters
        ----------
        arrival : int
            Monotonic time at which the scan arrived [ns].
        """
        self._sync.interrupt(self.time, arrival)

    def _repeat(self, counted: float, next_tick: bool, arrival: int) -> None:
        """Count on by the sequence, as the reading repeats the one before."""
        self._in_a_row += 1
        self.repeated += self.frozen
        time = self._count_on(counted)
        possible = self._not_of_future(time, arrival)
        if possible == time and self._in_a_row == 1 and next_tick:
            self._sync.widen(time - self.time, arrival)  # it stands still, or two scans were sampled at once
        self._counted, self.time = counted + (possible - time), possible

    def _count_on(self, counted: float) -> int:
        """Return the time by the sequence: a tick, but a scan is never sampled before the one before it."""
        return self._read_time + max(round(counted - self._late), 0)

    def _decide(self, read: int, by_sequence: int, arrival: int, slack: float) -> int:
        """Return that of two times which the arrival speaks for; what it leaves open is uncertain for a while."""
        delay, other = self._sync.delay(read, arrival), abs(self._sync.delay(by_sequence, arrival))
        time = by_sequence if other < abs(delay) and not EARLIEST <= delay <= other + PROMPT else read
        possible = self._not_of_future(time, arrival)
        if possible != time:  # neither is right
            return possible
        self._sync.doubt(time, arrival, min(time - min(read, by_sequence - slack), time - self.time))
        return time

    def _not_of_future(self, time: int, arrival: int) -> int:
        """Return the time, or the latest one that the arrival allows: the clock is in doubt then."""
        delay = self._sync.delay(time, arrival)
        if not delay < EARLIEST:
            return time
        latest = time + round(delay / 1000)
        self._sync.doubt(latest, arrival, latest - self.time)
        return latest

    def _take(self, reading: int, time: int) -> None:
        self._reading, self._read_time, self.time = reading, time, time
        self._counted, self._late, self._in_a_row = 0.0, 0.0, 0
