# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of a simulated board as a driver delivers them over a faulty link, without CAN frames in between."""

from __future__ import annotations

from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.link_faults import LOST_IN_RESETS, LinkFaults, TransmissionOutcome


class FaultyScans:
    """Scans of a board after the faults of its link: missing ones, and duplicates.

    A truncated scan is missing, too, as a driver discards incomplete scans. After a reset, sequence and device time of
    the scans restart at 0, and the first scan has STATUS_BOARD_RESET.

    Parameters
    ----------
    board : SimulatedBoard
        The board; its error model has the faults of the link.
    seed : int
        Seed that the error model is drawn from.
    counters : dict of str to int, optional
        Counters of a previous run, to continue.
    """

    def __init__(self, board: SimulatedBoard, seed: int, counters: dict[str, int] | None = None) -> None:
        self.board = board
        self._faults = LinkFaults(board.error_model, seed, counters)
        self._first = 0  # index of the first scan since the last reset; -1: not delivered yet
        self._flag_reset = False

    @property
    def counters(self) -> dict[str, int]:
        """Scans by outcome other than delivered, scans lost in resets, and resets."""
        return self._faults.counters

    def scan(self, index: int, out: Scan) -> int:
        """Compute scan `index` of the board, unless the link loses it.

        Parameters
        ----------
        index : int
            Index of the scan; ascends, as for the board.
        out : Scan
            Receives the scan; left alone when the scan is lost.

        Returns
        -------
        int
            How many times the scan is delivered: 0, 1 or 2.
        """
        faults = self._faults
        time = self.board.clock.time(index)
        if faults.reset_due(time):
            self._first = -1
        if time < faults.running_since:
            faults.counters[LOST_IN_RESETS] += 1
            return 0
        if self._first < 0:
            self._first, self._flag_reset = index, True
        outcome = faults.outcome(index)
        if outcome in {TransmissionOutcome.DROPPED, TransmissionOutcome.TRUNCATED}:
            return 0
        self.board.scan(index, out)
        if self._first:
            out.sequence -= self._first
            out.device_time -= round(self._first / self.board.sensor.can.scan_rate * 1e6)
        if self._flag_reset:
            out.status |= ScanStatus.BOARD_RESET
            self._flag_reset = False
        return 2 if outcome == TransmissionOutcome.DUPLICATED else 1
