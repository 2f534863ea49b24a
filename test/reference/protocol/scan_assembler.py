# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Assembles blocks into scans; incomplete scans are counted and discarded."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from posfet_driver.protocol.scan_codec import ScanCodec
from reference.protocol.scan_counts import unpack_counts


@dataclass(slots=True)
class ScanStatistics:
    """Frames and scans that were lost or rejected, by cause. Counters never fall."""

    malformed: int = 0
    """Frames with one of the board's identifiers and a wrong length, type or block index."""
    checksum: int = 0
    """FD blocks whose checksum does not fit their data."""
    duplicate: int = 0
    """Frames that arrived twice."""
    frozen_counter: int = 0
    """Frames that repeat an old scan counter with other data: the board's counter is frozen."""
    implausible: int = 0
    """Scans and headers whose sequence runs ahead of all clocks."""
    reordered: int = 0
    """Blocks that arrived after a later block of their scan; nothing is lost."""
    late: int = 0
    """Frames of a scan that had already been abandoned."""
    incomplete_scans: int = 0
    """Scans of which only some blocks arrived."""
    lost_scans: int = 0
    """Scans of which no block arrived."""
    missing_frames: int = 0
    """Frames of incomplete and lost scans that did not arrive."""


class BlockOutcome(Enum):
    """Effect of one block on the scan being assembled."""

    COLLECTED = "collected"
    COMPLETE = "complete"
    """The block completed the scan."""
    IGNORED = "ignored"
    """A duplicate, or a block of an abandoned scan."""
    CONFLICT = "conflict"
    """The block repeats an index of the scan with other data: two scans share one counter."""


_COLLECTED, _COMPLETE = BlockOutcome.COLLECTED, BlockOutcome.COMPLETE


class Assembler:
    """Collects the blocks of one scan at a time.

    `FdScans` or `ClassicScans` decides which scan a block belongs to. Boards send scans in order, so the current scan
    is abandoned when a later one begins.

    Parameters
    ----------
    codec : ScanCodec
        Frame format and size of the array.
    """

    def __init__(self, codec: ScanCodec) -> None:
        self.codec = codec
        self.statistics = ScanStatistics()
        self.counts = np.zeros(codec.taxels, np.uint16)
        """Counts of the last complete scan."""
        self.status = 0
        """Status of the current scan, from the block that arrived last."""
        length = codec.block_length
        self._wire = bytearray(codec.blocks * length)
        self._slots = [slice(block * length, (block + 1) * length) for block in range(codec.blocks)]
        self._all_blocks = (1 << codec.blocks) - 1
        self._received = 0  # bits of the blocks of the current scan
        self._abandoned = True  # no scan is being collected

    @property
    def complete(self) -> bool:
        """Whether the current scan is complete."""
        return self._received == self._all_blocks and not self._abandoned

    def begin(self) -> None:
        """Begin the next scan; the current one is counted if it is incomplete."""
        if self._received != self._all_blocks:
            self._give_up()
        self._received = 0
        self._abandoned = False

    def add(self, block: int, status: int, data: bytes) -> BlockOutcome:
        """Add one block to the current scan.

        Parameters
        ----------
        block : int
            Index of the block, in [0, blocks).
        status : int
            Status bits that the block carries.
        data : bytes
            Data of the frame.

        Returns
        -------
        BlockOutcome
            COMPLETE when this block completed the scan: `counts` holds it.
        """
        bit, slot = 1 << block, self._slots[block]
        if self._received & bit:
            if self._wire[slot] == data:
                self.statistics.duplicate += 1
                return BlockOutcome.IGNORED
            self.statistics.frozen_counter += 1
            self._give_up()
            return BlockOutcome.CONFLICT
        if self._abandoned:
            self.statistics.late += 1
            self._received |= bit
            self._wire[slot] = data
            return BlockOutcome.IGNORED
        if self._received > bit:
            self.statistics.reordered += 1
        self._received |= bit
        self.status = status
        self._wire[slot] = data
        if self._received != self._all_blocks:
            return _COLLECTED
        unpack_counts(self.codec.fd, self._wire, self.counts)
        return _COMPLETE

    def abandon(self) -> None:
        """Abandon the current scan; it is counted if it is incomplete."""
        self._give_up()
        self._received = 0

    def count_lost(self, scans: int) -> None:
        """Count scans of which no block arrived."""
        self.statistics.lost_scans += scans
        self.statistics.missing_frames += scans * self.codec.blocks

    def _give_up(self) -> None:
        """Count the current scan as incomplete, unless it is complete or was counted already."""
        if not self._abandoned and self._received != self._all_blocks:
            self.statistics.incomplete_scans += 1
            self.statistics.missing_frames += (self._all_blocks ^ self._received).bit_count()
        self._abandoned = True
