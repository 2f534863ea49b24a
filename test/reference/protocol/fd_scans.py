# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of CAN FD blocks: each block carries boot, sequence, device time and a checksum."""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import FD, RATE_SWITCH
from posfet_driver.protocol.scan_codec import FD_LENGTH, SEQUENCE, FdCodec, checksum
from reference.protocol.clock_sync import ClockSync
from reference.protocol.device_clock import DeviceClock
from reference.protocol.scan_assembler import Assembler, BlockOutcome
from reference.protocol.scan_numbering import Number, ScanNumbering

ROUNDING: Final = 1.0
"""Error of a device time [us]."""
_COMPLETE: Final = BlockOutcome.COMPLETE
_KINDS: Final = (FD | RATE_SWITCH, FD)


class FdScans:
    """Assigns each FD block to its scan.

    Parameters
    ----------
    assembler : Assembler
        Collects the blocks.
    sync : ClockSync
        Mapping of the board's clock.
    """

    def __init__(self, assembler: Assembler, sync: ClockSync) -> None:
        self.clock = DeviceClock(32, sync)
        self.numbering = ScanNumbering(assembler.statistics, self.clock, cautious=True)
        self._assembler = assembler
        self._statistics = assembler.statistics
        self._blocks = assembler.codec.blocks
        self._low = -1  # of the current scan: low bits of the sequence, boot, and time as sent
        self._boot = -1
        self._time = -1

    def early(self, sequence: int) -> float:
        """Return the time by which a scan may have been sampled after its time [us]: it is rounded.

        Parameters
        ----------
        sequence : int
            Sequence of the scan.
        """
        return ROUNDING

    late: Final = ROUNDING
    """Time by which a scan may have been sampled before its time [us]."""

    def announce(self, period: float, confirmed: bool) -> None:
        """Take a scan period that the board announces.

        Parameters
        ----------
        period : float
            Scan period [us].
        confirmed : bool
            Whether it was set.
        """
        self.numbering.announce(period, confirmed)

    @property
    def sequence(self) -> int:
        """Sequence of the current scan, unwrapped; -1 before the first."""
        return self.numbering.sequence

    @property
    def time(self) -> int:
        """Device time of the current scan, unwrapped [us]."""
        return self.clock.time

    def feed(self, kind: int, data: bytes, arrival: int) -> bool:
        """Process one block.

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
        bool
            Whether the block completed a scan, which the assembler then holds.
        """
        if len(data) != FD_LENGTH or kind not in _KINDS:
            self._statistics.malformed += 1
            return False
        sequence, time, block, state, crc = FdCodec.header(data)
        if crc != checksum(data):
            self._statistics.checksum += 1
            return False
        if block >= self._blocks:
            self._statistics.malformed += 1
            return False
        if sequence != self._low or state >> 4 != self._boot:
            if not self._begin(state >> 4, sequence, time, arrival):
                return False
        elif time != self._time:
            self._statistics.frozen_counter += 1
            self._assembler.abandon()
            self._time = time
            return False
        return self._assembler.add(block, state & 0xF, data) is _COMPLETE

    def start(self) -> None:
        """Accept any number next: the board was started."""
        self.numbering.open()

    def _begin(self, boot: int, sequence: int, time: int, arrival: int) -> bool:
        missing = self.numbering.missing(Number(boot, sequence, time), arrival)
        if missing is None or missing < 0:
            return False
        self._assembler.begin()
        if missing:
            self._assembler.count_lost(missing)
        self._low, self._boot, self._time = sequence & SEQUENCE, boot, time
        return True
