"""Scans of classic blocks: 4 bits of the sequence in each block, and headers that state it in full.

Between two headers the sequence is counted on. That is certain while fewer than 16 scans can be missing, which the time
tells: a scan whose number is 16 too low seems to be late by 16 scan periods. What may be so late is held until the next
header confirms its number.
"""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.clock_sync import ClockSync
from posfet_driver.protocol.device_clock import DeviceClock
from posfet_driver.protocol.scan_assembler import Assembler, BlockOutcome
from posfet_driver.protocol.scan_codec import CLASSIC_COUNTER, CLASSIC_LENGTH, HEADER_SCANS, ScanHeader
from posfet_driver.protocol.scan_numbering import FASTEST, SLACK, Number, ScanNumbering
from posfet_model.sensor.scan import Scan

LATE_BLOCKS: Final = 3
"""A counter that is up to this far behind belongs to a late frame; further behind, scans were lost [1]."""
CERTAIN: Final = HEADER_SCANS - LATE_BLOCKS - 1
"""Delay of a scan up to which its number is certain [scan periods]."""
MOST_HELD: Final = 2 * HEADER_SCANS
"""Scans that are held at most: by then two headers were lost, or the board sends none."""

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
        self.doubtful = False
        self._assembler = assembler
        self._statistics = assembler.statistics
        self._blocks = assembler.codec.blocks
        self._sync = sync
        self._announced = self._period = 0.0
        self._header = -1  # sequence of the newest header
        self._header_read = False  # its scan period can be measured up to the next one
        self._fresh = False  # no block since the newest header
        self._adrift = True  # no number until the next header
        self._arrival = 0  # of the newest header [ns]
        self._held: list[Scan] = []
        self._accounted = 0  # scans since the newest header that were delivered or counted as lost
        self._incomplete = 0  # incomplete scans up to the newest header

    @property
    def period(self) -> float:
        """Scan period [us], as announced by the board."""
        return self._announced

    @period.setter
    def period(self, period: float) -> None:  # numpydoc ignore=GL08
        if period != self._announced:
            self._announced = self._period = self.numbering.period = period
            self._header_read = False

    @property
    def time(self) -> int:  # numpydoc ignore=RT01
        """Device time of the current scan, unwrapped [us]: that of the newest header and the scan periods since.

        While the clock is frozen, it is computed from the sequence.
        """
        if self.clock.frozen:
            return round(self.sequence * self._announced)
        return self.clock.time + round((self.sequence - self._header) * self._period)

    def hold(self, scan: Scan) -> None:
        """Hold a complete scan until its number is confirmed; too many are dropped.

        Parameters
        ----------
        scan : Scan
            The scan, which stays as it is.
        """
        self._held.append(scan)
        if len(self._held) > MOST_HELD:
            self.lose_number()

    def lose_number(self) -> None:
        """Use no block until the next header; what is held is dropped, and counted then."""
        self._adrift = True
        self._held = []

    def feed_header(self, kind: int, data: bytes, arrival: int) -> list[Scan]:
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
        list of Scan
            The scans that were held and whose numbers are right.
        """
        header = ScanHeader.unpack(kind, data)
        if header is None:
            self._statistics.malformed += 1
            return []
        numbering, before = self.numbering, self.clock.time
        waited = (arrival - self._arrival) / 1000
        missing = numbering.missing(Number(header.boot, header.sequence, header.time), waited)
        if missing is None:
            self.doubtful |= header.boot == numbering.boot  # it is wrong, or what was counted since the last one
            return []
        if missing < 0:
            self._statistics.duplicate += 1
            return []
        overtaken = self.sequence - numbering.sequence  # scans whose blocks arrived before the header
        if not (self.doubtful or self._adrift or numbering.restarted) and 0 < overtaken <= LATE_BLOCKS:
            self._statistics.late += 1
            return []
        begun = overtaken == 0 and not (self._adrift or numbering.restarted)
        complete = begun and self._assembler.complete
        if not begun:
            self._assembler.abandon()
        released = self._end_group(missing, complete)
        self._measure_period(before, waited)
        self.sequence = self._header = numbering.sequence
        self._arrival, self._accounted = arrival, int(complete)
        if not begun:
            self._assembler.begin()
        self.doubtful = self._adrift = False
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
        if ahead > CERTAIN:
            self._statistics.late += 1
            return False
        if ahead:
            self._assembler.begin()
            self._count_lost(ahead - 1)
            self.sequence += ahead
        if ahead or self._fresh:
            late = self._sync.delay(self.time, arrival)
            uncertain = late > CERTAIN * self._announced * 1000 - self._sync.uncertainty
            self.doubtful |= uncertain or (self._fresh and ahead > 0)
            self._fresh = False
        outcome = self._assembler.add(block, 0, data)
        if outcome is _CONFLICT:
            self.lose_number()
        elif outcome is _COMPLETE:
            self._accounted += not self.doubtful
            return True
        return False

    def start(self) -> None:
        """Use no block until the next header, which may state any number: the board was started."""
        self.numbering.open()
        self.lose_number()

    def _end_group(self, missing: int, next_complete: bool) -> list[Scan]:
        """Account for the scans since the newest header; return those that were held and have the right number."""
        held, self._held = self._held, []
        incomplete, self._incomplete = self._incomplete, self._statistics.incomplete_scans
        if self._header < 0 or self.numbering.restarted:
            self._assembler.count_lost(len(held))
            return []
        right = 0 <= self.numbering.sequence - self.sequence <= HEADER_SCANS
        released = held if right and not self._adrift else []
        accounted = self._accounted + self._incomplete - incomplete + len(released) - next_complete
        self._assembler.count_lost(max(missing + 1 - accounted, 0))
        return released

    def _count_lost(self, scans: int) -> None:
        self._assembler.count_lost(scans)
        self._accounted += scans

    def _measure_period(self, before: int, waited: float) -> None:
        """Measure the scan period since the previous header.

        Its time [us] is `before`, and it arrived `waited` [us] ago: a clock that has jumped measures nothing.
        """
        clock, scans = self.clock, self.numbering.sequence - self._header
        measurable = self._header_read and scans <= HEADER_SCANS and not self.numbering.restarted
        self._header_read = not clock.frozen
        elapsed = clock.time - before
        if measurable and 0 < elapsed <= FASTEST * waited + SLACK * self._period:
            self._period = elapsed / scans
