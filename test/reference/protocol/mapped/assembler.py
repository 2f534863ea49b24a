# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Assembles the frames of a board with its own protocol into scans."""

from __future__ import annotations

from typing import Final

from posfet_core.protocol import ScanStatistics
from posfet_driver.protocol.frame_tables import FrameTables
from reference.protocol.mapped.readers import ReadPart

UNKNOWN: Final = -1
"""Sequence or time of a scan whose frames have held none yet."""
LATE: Final = 8
"""Scans behind the newest one whose frames count as late; more, and the counter has restarted or gone on."""


def late_scans(bits: int) -> int:
    """Return how far behind the newest scan frames are late, for a counter of so many bits."""
    return min(LATE, (1 << bits) // 4)


class MappedAssembler:
    """Collects the frames of one scan at a time; a scan of which a frame is missing is counted and discarded.

    When every frame holds the sequence, it tells which scan a frame belongs to, in whatever order the frames arrive.
    Otherwise frames must arrive in the order of sending, and a scan begins with its first frame; a sequence or time
    that only some frames hold must agree. As many frames lost in a row as a scan has cannot be noticed here.

    Parameters
    ----------
    tables : FrameTables
        Frames of the board.
    period : float
        Scan period [ns].
    """

    def __init__(self, tables: FrameTables, period: float) -> None:
        self.statistics = ScanStatistics()
        self.sequence = self.time = UNKNOWN
        """Sequence and time of the current scan as sent."""
        self.incomplete = 0
        """Scans begun in vain since the last complete one."""
        self.passed = 0
        """Scans by which the sequence has advanced since the last complete one, at least: incomplete ones tell."""
        self._slots = []
        at = 0
        for length in tables.slots:
            self._slots.append(slice(at, at + length))
            at += length
        self.wire = self._wire = bytearray(at + 1)
        """Data of the frames of a scan, and one zero byte."""
        self._all = (1 << tables.blocks) - 1
        self._received = self._all  # bits of the blocks of the current scan
        self._last = UNKNOWN  # block that arrived last
        self._abandoned = True
        self._joining = True  # the first scan: its first frames may have been sent before this one listened
        self._sequenced = tables.sequenced
        self._mask = (1 << tables.sequence_bits) - 1
        self._newest = self._mask - late_scans(tables.sequence_bits)  # beyond: late
        # A single frame that repeats the previous one may be the next scan, unless the time tells.
        self._repeats_are_told = tables.blocks > 1 or 0 < tables.tick <= period

    @property
    def collecting(self) -> bool:
        """Whether a scan has begun and is not complete."""
        return not self._abandoned and self._received != self._all

    def add(self, part: ReadPart, data: bytes) -> bool:
        """Add one frame.

        Parameters
        ----------
        part : ReadPart
            What the frame holds.
        data : bytes
            Its data, of the length that the DBC states.

        Returns
        -------
        bool
            Whether it completed a scan: the wire of the tables holds it.
        """
        block, bit = part.block, 1 << part.block
        sequence = part.sequence(data) if part.sequence else UNKNOWN
        time = part.time(data) if part.time else UNKNOWN
        if self._sequenced:
            if sequence != self.sequence:
                ahead = (sequence - self.sequence) & self._mask if self.sequence >= 0 else 0
                if ahead > self._newest:
                    self.statistics.late += 1
                    return False
                self._begin()
                self.sequence = sequence
                self.passed += ahead
            elif (self._received & bit or self._abandoned or self._received > bit) and not self._joins(
                bit, block, data
            ):
                return False
        elif not self._continues(block, bit, sequence, time, data):
            return False
        elif sequence >= 0:
            self.sequence = sequence
        self._wire[self._slots[block]] = data
        self._last = block
        if time >= 0:
            self.time = time
        received = self._received = self._received | bit
        if received != self._all:
            return False
        self._joining = False
        return True

    def abandon(self) -> None:
        """Abandon the current scan; it is counted if it is incomplete."""
        if self.collecting and not self._joining:
            statistics = self.statistics
            statistics.incomplete_scans += 1
            statistics.missing_frames += (self._all ^ self._received).bit_count()
            self.incomplete += 1
        self._abandoned = True

    def forget(self) -> None:
        """Abandon the current scan, and let any sequence be the next."""
        self.abandon()
        self.sequence = self._last = UNKNOWN
        self._received, self._joining = self._all, True

    def _begin(self) -> None:
        if self._received != self._all:
            self.abandon()
            self._joining = False
        self._received, self._abandoned = 0, False
        self.sequence = self.time = UNKNOWN

    def _joins(self, bit: int, block: int, data: bytes) -> bool:
        """Return whether a frame with the sequence of the current scan, but out of order, belongs to it."""
        statistics = self.statistics
        if self._received & bit:
            if self._wire[self._slots[block]] == data:
                statistics.duplicate += 1
            else:  # two scans share one counter
                statistics.frozen_counter += 1
                self.abandon()
            return False
        if self._abandoned:
            statistics.late += 1
            return False
        statistics.reordered += 1
        return True

    def _continues(self, block: int, bit: int, sequence: int, time: int, data: bytes) -> bool:
        """Return whether a frame without sequence continues the current scan or is the first of the next."""
        agrees = (sequence == self.sequence or sequence < 0 or self.sequence < 0) and (
            time == self.time or time < 0 or self.time < 0
        )
        if agrees and block == self._last and self._repeats_are_told and self._wire[self._slots[block]] == data:
            self.statistics.duplicate += 1
            return False
        if block == 0:
            self._begin()
            self._joining = False
            return True
        if agrees and self.collecting and self._received < bit:
            return True
        self.abandon()
        self._last = UNKNOWN
        self.statistics.late += not self._joining
        return False
