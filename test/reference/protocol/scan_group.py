# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The classic scans from one header to the next: those that wait for it, and the account of all."""

from __future__ import annotations

from typing import Final, NamedTuple

from posfet_driver.protocol.scan_codec import HEADER_SCANS
from posfet_model.sensor.scan import Scan
from reference.protocol.scan_assembler import Assembler
from reference.protocol.tick_line import TickLine

MOST_HELD: Final = 2 * HEADER_SCANS
"""Scans that are held at most: by then two headers were lost, or the board sends none."""


class Held(NamedTuple):
    """A complete scan whose number or time is not confirmed yet."""

    scan: Scan
    """The scan; its stamp is of no use yet."""
    device_time: int
    """Its time on the board's clock, unwrapped [us], which the scan itself does not state while that is frozen."""
    timed: bool
    """Whether its time is certain: else the next header tells it."""
    stalled: bool
    """Whether the board's clock stood still: its time is counted on, and nobody knows how wrong it is."""


class ScanGroup:
    """The scans since the newest header, and older ones whose time the next header may tell.

    Parameters
    ----------
    ticks : TickLine
        Tells the time of a scan.
    assembler : Assembler
        Counts what is lost.
    """

    def __init__(self, ticks: TickLine, assembler: Assembler) -> None:
        self.accounted = 0
        """Scans since the newest header that were delivered or counted as lost."""
        self._ticks = ticks
        self._assembler = assembler
        self._held: list[Held] = []
        self._carried = 0  # of them, older than the newest header
        self._incomplete = 0  # incomplete scans up to the newest header

    @property
    def waits(self) -> bool:
        """Whether any scan is held."""
        return bool(self._held)

    def hold(self, scan: Scan, device_time: int, stalled: bool) -> bool:
        """Hold a scan until the next header.

        Parameters
        ----------
        scan : Scan
            The scan, which stays as it is.
        device_time : int
            Its time on the board's clock, unwrapped [us].
        stalled : bool
            Whether the board's clock stands still.

        Returns
        -------
        bool
            False when too many are held.
        """
        self._held.append(Held(scan, device_time, self._ticks.certain, stalled))
        return len(self._held) <= MOST_HELD

    def drop(self) -> None:
        """Drop all that is held: the next header counts it as lost."""
        self.drop_untimed()
        self._held = []

    def drop_untimed(self) -> None:
        """Drop the scans whose time is not certain, and those that are older than the newest header."""
        self._assembler.count_lost(self._carried)
        self._held, self._carried = [held for held in self._held[self._carried :] if held.timed], 0

    def count_lost(self, scans: int) -> None:
        """Count scans since the newest header as lost."""
        self._assembler.count_lost(scans)
        self.accounted += scans

    def restart(self) -> None:
        """Begin with the next header: how many scans are missing before it is not known."""
        self._assembler.count_lost(len(self._held))
        self._begin(complete=False)

    def end(self, header: int, missing: int, right: bool, next_complete: bool) -> list[Held]:
        """Account for the scans up to the next header, which is on the line of ticks already.

        Parameters
        ----------
        header : int
            Sequence of the header of this group.
        missing : int
            Number of scans between the two headers.
        right : bool
            Whether the next header confirms the numbers that were counted.
        next_complete : bool
            Whether its scan was completed, and accounted for here.

        Returns
        -------
        list of Held
            The scans that were held and have the right number; those whose time the header after that may tell are held
            on.
        """
        held, carried, incomplete, accounted = self._held, self._carried, self._incomplete, self.accounted
        self._begin(next_complete)
        released = [self._timed(one, header) for one in held if right and (one.timed or self._ticks.certain)]
        if right and not self._ticks.certain:
            self._held = [one for one in held if not one.timed and self._ticks.spans(one.scan.sequence)]
            self._carried = len(self._held)
        settled = len(released) + self._carried - carried
        accounted += self._incomplete - incomplete + settled - next_complete
        self._assembler.count_lost(max(missing + 1 - accounted, 0))
        return released

    def _begin(self, complete: bool) -> None:
        """Begin the next group, whose first scan may be `complete`."""
        self._held, self._carried, self.accounted = [], 0, int(complete)
        self._incomplete = self._assembler.statistics.incomplete_scans

    def _timed(self, held: Held, header: int) -> Held:
        """Return a scan that was held with its time by the ticks up to the newest header.

        That may show that the headers before were sampled late, and so the times that were counted from them too high.
        """
        scan = held.scan
        if scan.sequence == header or (held.timed and not self._ticks.continued):
            return held
        time = self._ticks.time(scan.sequence)
        if held.timed and time >= held.device_time:
            return held
        scan.device_time = time if scan.device_time else 0
        return held._replace(device_time=time, timed=True)
