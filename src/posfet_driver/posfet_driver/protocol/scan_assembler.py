"""Blocks to whole scans: what is torn, lost, repeated or late is told apart and counted, never handed on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_driver.protocol.scan_codec import CLASSIC_COUNTER, FD_CLOCK, ScanCodec

CLASSIC_WRAP: Final = CLASSIC_COUNTER + 1
CLASSIC_LATE: Final = 3
"""A 4-bit counter that is up to this far behind belongs to a late frame; further, and scans were lost."""
CLOCK_STANDS: Final = 3
"""Scans in a row with the time of the one before, from which the board's clock is not used."""
SCAN_PAGE: Final = 0x1_0000
NUMBER_WRAP: Final = 0x1_0000_0000


@dataclass(slots=True)
class Losses:
    """What did not become a scan, by cause; never falls."""

    malformed: int = 0
    """Frames with the board's identifier that cannot be its."""
    repeated: int = 0
    """Frames that came twice."""
    stuck: int = 0
    """Frames with the number of an older scan and other contents: the board's counter stands still."""
    clock_stuck: int = 0
    """Scans with the time of the scan before: the board's clock stands still; no loss."""
    reordered: int = 0
    """Blocks that came after a later one of their scan; no loss."""
    late: int = 0
    """Frames of a scan that was given up already."""
    torn_scans: int = 0
    """Scans of which only a part came."""
    lost_scans: int = 0
    """Scans of which nothing came."""
    frames: int = 0
    """Frames that did not come, of torn and of lost scans."""


def nearest(number: int, low: int, wrap: int) -> int:
    """Return what is equal to `low` modulo `wrap` and nearest to `number`.

    >>> nearest(0x1_FFFF, 3, 0x1_0000)
    131075
    """
    return number + (low - number + wrap // 2) % wrap - wrap // 2


class Assembler:
    """Collects the blocks of one board's scans.

    Frames of one scan share its counter and, with CAN FD, its time. Boards send scans in order, so a scan is given up
    when a later one begins. A classic counter has 4 bits: the caller sees to it that fewer than 13 scans are lost
    between two classic frames that are fed, or tells the number (`Numbering`).
    """

    def __init__(self, codec: ScanCodec) -> None:
        self.codec = codec
        self.losses = Losses()
        self.counts = np.zeros(codec.taxels, np.uint16)
        """Counts of the last whole scan."""
        self.sequence = -1
        """Number of the scan that was begun last, wraps undone; -1 before the first."""
        self.device_time = 0
        """Its time on the board's clock [us], wraps undone."""
        self.status = 0
        """Its status, from the block that came last."""
        self.misled = False
        """Whether the counter of classic scans stood still since somebody cleared this."""
        self._wire = codec.wire
        length = codec.block_length
        self._places = [slice(block * length, (block + 1) * length) for block in range(codec.blocks)]
        self._whole = (1 << codec.blocks) - 1
        self._mask = codec.counter_mask
        self._half = (codec.counter_mask + 1) // 2
        self._seen = 0  # blocks of the scan being collected
        self._given_up = True  # nothing is being collected
        self._clock = 0  # device time on the wire
        self._synced = False  # `sequence` is a scan of this board
        self._clock_synced = False  # and so is `device_time`
        self._standing = 0  # scans in a row with the time of the one before
        self._announced = False  # the next scan is the one that the board said comes next
        self._first = -1  # the counter that came instead

    @property
    def clock_stands(self) -> bool:
        """Whether the board's clock stands still while its scans go on."""
        return self._standing >= CLOCK_STANDS

    @property
    def whole(self) -> bool:
        """Whether the scan that was begun last is whole."""
        return self._seen == self._whole and not self._given_up

    def resync(self, next_scan: int, count_gap: bool = True, reset: bool = False) -> bool:
        """Take the low 32 bits of the number of the scan that comes next; return whether the board was reset.

        With `count_gap` what lies between the last scan and this one is counted as lost. After a reset, which the board
        tells (`reset`) or a number well below the last one shows, numbers and time begin anew.
        """
        ahead = nearest(self.sequence, next_scan, NUMBER_WRAP) - self.sequence
        reset = self._synced and (reset or ahead <= -CLASSIC_LATE)
        if self._synced and not reset:
            if ahead > 1:  # else scans have overtaken the answer
                self._give_up()
                self._lose((ahead - 1) * count_gap)
                self.sequence += ahead - 1
                self._announce()
            return False
        self._give_up()
        self.sequence = next_scan - 1
        self._clock_synced = self.misled = False
        self._synced = True
        self._announce()
        return reset

    def align(self, newest: int, wrap: int) -> None:
        """Take the number of the newest scan modulo `wrap`, as boards tell it between two scans.

        A classic counter does not show that a multiple of 16 scans was lost; this does. What the counter shows is left
        to it. A number below the one known takes back what was counted.
        """
        ahead = nearest(self.sequence, newest, wrap) - self.sequence
        if self.codec.fd or -CLASSIC_LATE <= ahead < CLASSIC_WRAP - CLASSIC_LATE:
            return
        self.jump(ahead)

    def jump(self, ahead: int) -> None:
        """Go on `ahead` of the newest scan; those between are lost."""
        self._give_up()
        self._seen = 0
        self._announced = False
        if self._synced:
            self._lose(ahead)
        self._synced = True
        self.sequence += ahead

    def feed(self, offset: int, kind: int, data: bytes) -> bool:
        """Take one frame, `offset` its identifier less the board's base; return True when it made a scan whole."""
        header = self.codec.header(offset, kind, data)
        if header is None:
            self.losses.malformed += 1
            return False
        clock, counter, block, status = header
        same = clock == self._clock and counter == self.sequence & self._mask
        if not same and not (self._announced and self._doubtful(counter)) and not self._begin(counter, clock):
            return False
        bit, place = 1 << block, self._places[block]
        if self._seen & bit:
            if self._wire[place] == data:
                self.losses.repeated += 1
            else:
                self.losses.stuck += 1
                self.misled = True
                self._give_up()
            return False
        if self._given_up:
            self.losses.late += 1
            self._seen |= bit
            self._wire[place] = data
            return False
        if self._seen > bit:
            self.losses.reordered += 1
        self._seen |= bit
        self.status = status
        self._wire[place] = data
        if self._seen != self._whole:
            return False
        self.codec.decode(self.counts)
        return True

    def _announce(self) -> None:
        """Take note that the board said which scan comes next: with CAN FD its time tells all the same."""
        self._announced, self._first, self._seen = not self.codec.fd, -1, 0

    def _doubtful(self, counter: int) -> bool:
        """Return whether a classic counter, the first after an announcement, may stand still.

        When it is not the announced one, scans were lost, or it does not count: until it does, its scan is given up.
        """
        if self._first < 0 and counter != (self.sequence + 1) & CLASSIC_COUNTER:
            self._first = counter
        self._announced = counter == self._first
        return self._announced

    def _begin(self, counter: int, clock: int) -> bool:
        """Begin the scan that a frame belongs to; False when the frame is of no use."""
        ahead = (counter - self.sequence) & self._mask
        if not self._synced:
            self.sequence, ahead = counter - 1, 1
        elif self.codec.fd:
            if ahead == 0:  # the clock runs all the while
                self.losses.stuck += 1
                return False
            if ahead >= self._half:
                self.losses.late += 1
                return False
        elif ahead > self._mask - CLASSIC_LATE:
            self.losses.late += 1
            return False
        if self._seen != self._whole:
            self._give_up()
        if ahead > 1:
            self._lose(ahead - 1)
        self.sequence += ahead
        if self.codec.fd:
            if clock == self._clock and self._clock_synced:
                self._standing += 1
                self.losses.clock_stuck += 1
            else:
                self._standing = 0
        self.device_time = self.device_time + ((clock - self._clock) & FD_CLOCK) if self._clock_synced else clock
        self._synced = self._clock_synced = True
        self._clock = clock
        self._seen = 0
        self._given_up = False
        return True

    def _give_up(self) -> None:
        """Count the scan being collected as torn, unless it is whole or was counted already."""
        if not self._given_up and self._seen != self._whole:
            self.losses.torn_scans += 1
            self.losses.frames += (self._whole ^ self._seen).bit_count()
        self._given_up = True

    def _lose(self, scans: int) -> None:
        self.losses.lost_scans += scans
        self.losses.frames += scans * self.codec.blocks
