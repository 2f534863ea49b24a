# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sequence and time of the scans of a board with its own protocol; what the board does not send is estimated."""

from __future__ import annotations

from typing import Final

from posfet_core.protocol import FROZEN_READINGS
from posfet_driver.protocol.frame_tables import FrameTables
from reference.protocol.ascending_stamps import AscendingStamps
from reference.protocol.clock_sync import ClockSync
from reference.protocol.mapped.arrival_line import RATE_TOLERANCE, ArrivalLine
from reference.protocol.mapped.assembler import LATE, MappedAssembler, late_scans

RESET_MARGIN: Final = 50e6
"""Time by which counter or clock have to be ahead of the arrivals for a restart of the board [ns]; assumed."""
MISSING_SHARE: Final = 0.45
"""Share of a pause without frames from which on whole scans are missing: less than a half, of two frames per scan."""
MISSING_SCANS: Final = 1.5
"""The same in scans, after a long pause: frames come in batches."""


class MappedNumbering:
    """Unwraps the board's counter and clock, each with the help of the other and of the arrivals.

    Without a counter, the sequence is counted by the board's time, and without both by the arrivals
    (`ArrivalLine`). Then lost scans are an estimate, and the scan rate of the sensor file has to be right to within
    `RATE_TOLERANCE`. A counter or clock that moves further than the time since the previous scan allows has restarted.

    Parameters
    ----------
    tables : FrameTables
        Lengths of counter and time.
    period : float
        Scan period [ns].
    assembler : MappedAssembler
        Source of the scans; its statistics count lost ones.
    """

    def __init__(self, tables: FrameTables, period: float, assembler: MappedAssembler) -> None:
        self.sequence = -1
        """Sequence of the newest scan, unwrapped."""
        self.device_time = 0
        """Time of the newest scan on the board's clock, unwrapped [us]."""
        self.was_reset = False
        """Whether the board restarted before the newest scan."""
        self.clock_frozen = False
        """Whether the board's clock stands still while its scans go on."""
        self.frozen_clock = 0
        """Scans during which it stood still."""
        self._assembler, self._statistics = assembler, assembler.statistics
        self._period, self._tick, self._blocks = period, tables.tick, tables.blocks
        self._counted, self._timed = tables.sequence_bits > 0, tables.time_bits > 0
        self._wrap, self._time_wrap = 1 << tables.sequence_bits, 1 << tables.time_bits
        self._late_from = self._wrap - late_scans(tables.sequence_bits)
        late_ticks = LATE * period // self._tick if self._timed else 0
        self._ticks_back = self._time_wrap - min(late_ticks, self._time_wrap // 4)  # beyond: late, too
        self._counter_span = self._wrap * period if self._counted else 0.0
        self._clock_span = self._time_wrap * self._tick if self._timed else 0.0
        self._span = max(self._counter_span, self._clock_span, period)  # a loss of this length leaves no trace
        self._line = ArrivalLine(period)
        self._clock = ClockSync()
        self._ascending = AscendingStamps()
        self._counter = self._wire_time = self._ticks = 0
        self._surplus = 0.0  # periods that the board's time is ahead of the counted scans
        self._still = 0  # consecutive scans with the same time

    @property
    def clock_uncertainty(self) -> float:
        """As that of ClockSync, and that by the order of stamps [ns]."""
        return self._clock.uncertainty + self._ascending.excess

    def begin_batch(self, arrival: int, frames: int) -> None:
        """Begin a batch of frames.

        Parameters
        ----------
        arrival : int
            Monotonic time at which it was read [ns].
        frames : int
            Number of frames in it, those of others included.
        """
        self._line.begin_batch(arrival, frames / self._blocks)

    def frames_are_missing(self, arrival: int, frames: int) -> bool:
        """Return whether a batch has so few frames for the time since the previous one that whole scans are missing.

        Parameters
        ----------
        arrival : int
            Monotonic time at which it was read [ns].
        frames : int
            Number of the board's frames in it.
        """
        pause = (arrival - self._line.arrival) / self._period
        missing = pause - frames / self._blocks
        return missing > max(MISSING_SHARE, min(MISSING_SHARE * pause, MISSING_SCANS))

    def accept(self) -> bool:
        """Take the scan that the assembler has completed; return whether it is a new one, which is numbered then."""
        assembler, line, period = self._assembler, self._line, self._period
        counter, time = assembler.sequence, assembler.time
        self.was_reset = False
        if self.sequence < 0:
            self._restart(counter)
            return True
        ticks = 0
        if self._timed:
            ticks = (time - self._wire_time) % self._time_wrap
            if ticks == 0 or self._still:
                self._watch_clock(ticks)
        if self._counted:
            ahead = (counter - self._counter) % self._wrap
            if ahead != 1 or assembler.passed > 1 or ticks * self._tick > 2 * period:
                ahead, ticks = self._unwrapped(ahead, ticks)
            if ahead <= 0:
                return False
        elif self._timed and not self.clock_frozen:
            if ticks > self._ticks_back:
                self._statistics.late += 1
                return False
            ahead = self._scans_in(ticks)
        else:
            ahead = 1 + assembler.incomplete
        passed = max(ahead * period, ticks * self._tick)
        if passed > RESET_MARGIN and passed > (line.room() + RESET_MARGIN + 2 * period) * (1.0 + RATE_TOLERANCE):
            self.was_reset = True
            self._clock.reset()
            self._restart(counter if self._counted else self.sequence + 1)
            return True
        line.advance(ahead)
        if unnoticed := line.missing(self._span) * self._span:
            ahead += round(unnoticed / period / self._wrap) * self._wrap
            ticks += round(unnoticed / self._clock_span) * self._time_wrap if self._timed else 0
        if ahead > 1:
            lost = max(ahead - 1 - assembler.incomplete, 0)
            self._statistics.lost_scans += lost
            self._statistics.missing_frames += lost * self._blocks
        self._take(self.sequence + ahead, self._ticks + ticks)
        return True

    def stamp(self) -> int:
        """Return the monotonic time of acquisition of the newest scan [ns]; to be called once for each."""
        arrival, time = self._line.arrival, round(self._line.time)
        if self._timed and not self.clock_frozen:
            time = self._clock.to_monotonic(self.device_time, arrival)
        return self._ascending.stamp(time, self.device_time, arrival)

    def _unwrapped(self, ahead: int, ticks: int) -> tuple[int, int]:
        """Return how far counter and time have advanced; whichever wraps later tells how often the other one has.

        A scan with the counter of the newest one, or of one shortly before, is counted and not ahead.
        """
        expected, span = 0.0, ticks * self._tick
        ahead += self._turns(ahead)
        told = 0 < ahead == self._assembler.passed  # by the scans in between, of which frames are missing
        if self._counter_span >= self._clock_span:
            if (told or ahead < self._late_from) and self._timed:
                ticks += max(round((ahead * self._period - span) / self._clock_span), 0) * self._time_wrap
        elif span < self._clock_span / 2:  # else the time has gone back
            expected = span / self._period
            ahead += max(round((expected - ahead) / self._wrap), 0) * self._wrap
        if ahead == 0:
            self._statistics.frozen_counter += 1
        elif not told and ahead >= self._late_from and ahead - expected > self._wrap / 2:
            self._statistics.late += 1
            ahead = 0
        return ahead, ticks

    def _turns(self, ahead: int) -> int:
        """Return the scans in the whole turns of the counter that incomplete scans show, if they fit the time."""
        turns = -(-(self._assembler.passed - ahead) // self._wrap) * self._wrap
        fits = (ahead + turns - self._wrap / 2) * self._period <= self._line.room()
        return turns if turns > 0 and fits else 0

    def _watch_clock(self, ticks: int) -> None:
        """Note whether the clock stands still for longer than its steps explain."""
        self._still = 0 if ticks else self._still + 1
        frozen = self._still >= FROZEN_READINGS and self._still * self._period > 2 * self._tick
        self.frozen_clock += frozen
        if frozen != self.clock_frozen:
            self.clock_frozen = frozen
            self._clock.reset()

    def _scans_in(self, ticks: int) -> int:
        """Return how many scans the board's time has advanced by.

        Steps of the clock may be as long as a period, so that it advances by none and then by two. What is too little
        is kept for the next scan, and slowly forgotten, for the rate of the sensor file is not exact.
        """
        surplus = self._surplus + ticks * self._tick / self._period - 1.0
        lost = max(round(surplus), 0)
        surplus -= lost
        self._surplus = surplus - min(max(surplus, -RATE_TOLERANCE), RATE_TOLERANCE)
        return 1 + lost

    def _restart(self, sequence: int) -> None:
        self._surplus = 0.0
        self._line.restart()
        self._take(max(sequence, 0), max(self._assembler.time, 0))

    def _take(self, sequence: int, ticks: int) -> None:
        assembler = self._assembler
        assembler.incomplete = assembler.passed = 0
        self.sequence, self._ticks = sequence, ticks
        self._counter, self._wire_time = assembler.sequence, assembler.time
        self.device_time = round(ticks * self._tick / 1e3)
