# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of classic blocks: 4 bits of the sequence in each block, and headers that state it in full.

Between two headers the sequence is counted on. That is certain while fewer than 16 scans can be missing, which the time
tells: a block whose number is 16 too low seems to be late by 16 scan periods. A scan with a block that may be so late
is held until the next header confirms its number. So is one whose time is not known, as the scan period may have
changed.
"""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.scan_codec import CLASSIC_COUNTER, CLASSIC_LENGTH, HEADER_SCANS, SEQUENCE, ScanHeader
from posfet_model.sensor.scan import Scan
from reference.protocol.clock_sync import ClockSync
from reference.protocol.device_clock import DeviceClock
from reference.protocol.scan_assembler import Assembler, BlockOutcome
from reference.protocol.scan_group import Held, ScanGroup
from reference.protocol.scan_numbering import TOLERANCE, Number, ScanNumbering
from reference.protocol.tick_line import AGREEMENT, TickLine

LATE_BLOCKS: Final = 3
"""A counter that is up to this far behind belongs to a late frame; further behind, scans were lost [1]."""
CERTAIN: Final = HEADER_SCANS - LATE_BLOCKS - 1
"""Delay of a scan up to which its number is certain [scan periods]."""
DISPUTE: Final = 2_000_000_000
"""Time after another host has set the scan period in which an announced period may be an earlier one [ns]: as long as
responses may be late; assumed."""

_COMPLETE: Final = BlockOutcome.COMPLETE
_CONFLICT: Final = BlockOutcome.CONFLICT


class ClassicScans:
    """Assigns each classic block to its scan.

    Parameters
    ----------
    assembler : Assembler
        Collects the blocks.
    sync : ClockSync
        Mapping of the board's clock, which tells how late a scan is.
    """

    def __init__(self, assembler: Assembler, sync: ClockSync) -> None:
        self.clock = DeviceClock(28, sync)
        self.numbering = ScanNumbering(assembler.statistics, self.clock, cautious=False)
        self.sequence = -1
        """Sequence of the current scan; while `doubtful` it has to be confirmed by the next header."""
        self.time = 0
        """Device time of the current scan, unwrapped [us]: that of its header, or of its tick when it has none."""
        self.doubtful = False
        self.overflowed = False
        """Whether frames were lost within the present batch, nobody knows where: no time tells a block's number."""
        self._assembler = assembler
        self._statistics = assembler.statistics
        self._blocks = assembler.codec.blocks
        self._sync = sync
        self._period = 0.0  # by which the two limits are [us]
        self._earliest = self._latest = 0.0  # delays of a block whose number is certain [ns]
        self._deadline = 0.0  # arrival up to which the number of another block of the current scan is certain [ns]
        self._disputed = -DISPUTE  # when another host has last set the period [ns]
        self._unconfirmed = False  # whether only an identity states the announced period
        self._ticks = TickLine()
        self._header = -1  # sequence of the newest header
        self._confirmed = sync.save()  # at the newest header
        self._fresh = False  # no block since the newest header
        self._adrift = True  # no number until the next header
        self._group = ScanGroup(self._ticks, assembler)
        self._delivered = -1  # sequence of the newest scan whose number was certain; -1 before the first

    @property
    def dated(self) -> bool:
        """Whether the time of the current scan is that of its header, or its number is certain; the first one's is."""
        return not self.doubtful or self.sequence == self._header or not self._sync.known

    def early(self, sequence: int) -> float:
        """Return the time by which a scan may have been sampled after its time [us]: one without a header, late.

        Parameters
        ----------
        sequence : int
            Sequence of the scan.
        """
        return AGREEMENT if sequence == self._header else self.numbering.period

    @property
    def late(self) -> float:
        """Time by which a scan may have been sampled before its time [us]: the headers may all have been late."""
        return AGREEMENT if self._ticks.agreed else self.numbering.period

    def announce(self, period: float, confirmed: bool) -> None:
        """Take a scan period that the board announces.

        Parameters
        ----------
        period : float
            Scan period [us].
        confirmed : bool
            Whether it was set; else the next headers have to confirm it.
        """
        changed = self.numbering.announce(period, confirmed)
        self._unconfirmed = not confirmed and (changed or self._unconfirmed)
        if changed:
            self._adrift = True  # the first scan at the new period has a header
            self._set_limits(period)
            self._restart_ticks()
            self._group.drop_untimed()

    def dispute_period(self, arrival: int) -> None:
        """Note that another host sets the scan period; `arrival` is that of its command [ns]."""
        self._disputed = arrival
        self._ticks.question()

    def hold(self, scan: Scan) -> None:
        """Hold a complete scan until its number is confirmed; too many are dropped.

        Parameters
        ----------
        scan : Scan
            The scan, which stays as it is.
        """
        if not self._group.hold(scan, self.time, self.clock.stalled):
            self.lose_number()

    def lose_number(self) -> None:
        """Use no block until the next header; what is held is dropped, and counted then."""
        self._adrift = True
        self._group.drop()

    def feed_header(self, kind: int, data: bytes, arrival: int) -> list[Held]:
        """Process a header.

        Parameters
        ----------
        kind : int
            Kind of the frame.
        data : bytes
            Data of the frame.
        arrival : int
            Monotonic time of its arrival [ns].

        Returns
        -------
        list of Held
            The scans that were held and whose numbers are right.
        """
        header = ScanHeader.unpack(kind, data)
        if header is None:
            self._statistics.malformed += 1
            return []
        numbering = self.numbering
        missing = self._missing(header, arrival)
        if missing is None:
            self.doubtful |= header.boot == numbering.boot  # it is wrong, or what was counted since the last one
            return []
        if missing < 0:
            self._statistics.duplicate += 1
            return []
        if self._is_overtaken():
            self._statistics.late += 1
            return []
        begun = self.sequence == numbering.sequence and not (self._adrift or numbering.restarted)
        complete = begun and self._assembler.complete
        if not begun:
            self._assembler.abandon()
        if numbering.restarted:
            self._restart_ticks()
            self._delivered = -1
        self._ticks.add(numbering.sequence, self.clock.time, self.clock.stalled)
        numbering.period = self._ticks.nominal
        self._set_limits(numbering.period)
        if self._ticks.lowered:
            self._sync.doubt(self.clock.time, arrival)  # the times of the scans since were ahead of the clock
        if self._group.waits:  # their times tell nothing, but may have to be stamped by this one
            self._sync.to_monotonic(self.clock.time, arrival)
        released = self._end_group(missing, complete)
        if released:
            self._delivered = released[-1].scan.sequence
        self._confirmed = self._sync.save()
        self.sequence = self._header = numbering.sequence
        self.time = self.clock.time
        if not begun:
            self._assembler.begin()
        self.doubtful, self._adrift = self.overflowed or not self._ticks.certain, False
        self._fresh = not begun
        return released

    def feed(self, block: int, kind: int, data: bytes, arrival: int) -> bool:
        """Process one block.

        Parameters
        ----------
        block : int
            Index of the block.
        kind : int
            Kind of the frame.
        data : bytes
            Data of the frame.
        arrival : int
            Monotonic time of its arrival [ns].

        Returns
        -------
        bool
            Whether the block completed a scan, which the assembler then holds.
        """
        if len(data) != CLASSIC_LENGTH or kind != CLASSIC or not 0 <= block < self._blocks:
            self._statistics.malformed += 1
            return False
        if self._adrift:
            return False
        ahead = (data[0] - self.sequence) & CLASSIC_COUNTER
        leaps = False
        if ahead > CERTAIN:
            self._statistics.late += 1
            return False
        if ahead or self._fresh:
            leaps = ahead > 1 or (self._fresh and ahead > 0)
            time = self._ticks.time(self.sequence + ahead) if ahead else self.clock.time
            delay = self._sync.delay(time, arrival)
            early = delay < self._earliest
            if early and ahead > 1:
                self._statistics.late += 1
                return False
            self._deadline = arrival + self._latest - delay - self._sync.drift
            self.doubtful |= early or (leaps and self._fresh) or self.overflowed or not self._ticks.certain
            self._fresh = False
            self.time = time
        if arrival > self._deadline:
            self.doubtful = True
        if ahead:
            self._assembler.begin()
            self._group.count_lost(ahead - 1)
            self.sequence += ahead
        outcome = self._assembler.add(block, 0, data)
        if outcome is _CONFLICT:
            self.lose_number()
        elif leaps and block > 0:  # its first blocks are lost, or it was overtaken and is of the scan 16 earlier
            self._assembler.abandon()
        elif outcome is _COMPLETE:
            if not self.doubtful:
                self._group.accounted += 1
                self._delivered = self.sequence
            return True
        return False

    def start(self) -> None:
        """Use no block until the next header, which may state any number: the board was started."""
        self.numbering.open()
        self.lose_number()

    def _missing(self, header: ScanHeader, arrival: int) -> int | None:
        """Return how many scans are missing before that of a header, as `ScanNumbering.missing` does."""
        if self._adrift or not self._confirms(header):
            self._sync.restore(self._confirmed)
        number = Number(header.boot, header.sequence, header.time)
        if self._has_fallen(header):
            return self.numbering.begin_again(number, arrival)
        return self.numbering.missing(number, arrival)

    def _is_overtaken(self) -> bool:
        """Return whether blocks of later scans arrived before the newest header."""
        if self._adrift or self.numbering.restarted:
            return False
        newest = self._delivered if self.doubtful else self.sequence
        return 0 < newest - self.numbering.sequence <= LATE_BLOCKS

    def _confirms(self, header: ScanHeader) -> bool:
        """Return whether a header states what was counted since the one before, and a time that is not earlier."""
        ahead = (header.sequence - self.sequence + LATE_BLOCKS) & SEQUENCE
        if header.boot != self.numbering.boot or ahead >= HEADER_SCANS + LATE_BLOCKS:
            return False
        counted = self._ticks.time(self.sequence + ahead - LATE_BLOCKS) - self.clock.time
        return counted - self.clock.ahead(header.time) <= TOLERANCE * self.numbering.announced

    def _has_fallen(self, header: ScanHeader) -> bool:
        """Return whether a header follows the newest one, but not scans that were sent and numbered before it."""
        numbering = self.numbering
        if header.boot != numbering.boot or self._delivered < 0:
            return False
        behind, ahead = (self._delivered - header.sequence) & SEQUENCE, self._delivered - numbering.sequence
        return (-1 if self._adrift else LATE_BLOCKS) < behind < ahead

    def _end_group(self, missing: int, next_complete: bool) -> list[Held]:
        """Account for the scans since the newest header; return those that were held and have the right number."""
        if self._header < 0 or self.numbering.restarted:
            self._group.restart()
            return []
        right = 0 <= self.numbering.sequence - self.sequence < HEADER_SCANS  # else a block has overtaken its header
        return self._group.end(self._header, missing, right, next_complete)

    def _restart_ticks(self) -> None:
        """Begin another line of ticks, at the announced period; in question if that may not be the one in force."""
        self._ticks.restart(self.numbering.announced)
        if self._unconfirmed or self._sync.last - self._disputed < DISPUTE:
            self._ticks.question()

    def _set_limits(self, period: float) -> None:
        if period != self._period:
            self._period = period
            self._earliest, self._latest = -TOLERANCE * period * 1000, CERTAIN * period * 1000
