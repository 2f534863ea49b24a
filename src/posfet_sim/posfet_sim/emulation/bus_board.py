# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board as a node on a CAN bus, with the faults of its link."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from posfet_driver.bus.frame import FD, Frame
from posfet_driver.protocol.messages import CLASSIC_BLOCK_OFFSET, FD_BLOCK_OFFSET, HEADER_OFFSET
from posfet_driver.protocol.scan_codec import CLASSIC_LENGTH, FD_LENGTH
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.scan import Scan
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.backlog import LATE_STEP
from posfet_sim.emulation.firmware import BoardFirmware, with_whole_period
from posfet_sim.emulation.link_faults import LinkFaults, TransmissionOutcome

_OF_SCANS: Final = {FD_BLOCK_OFFSET, HEADER_OFFSET}


class BusBoard:
    """Firmware of a board with clock drift, link faults and resets.

    Frames that carry scans are dropped, truncated to half their data (a length that CAN FD and classic CAN can carry),
    or duplicated. A reset stops the scans: after its silence a fresh firmware runs and waits for the start command.
    The film remembers, and only the first power-on says that its charge begins anew.
    The scene of `board` begins with the scan that follows the first start command, so that no part of it passes before.

    Parameters
    ----------
    board : SimulatedBoard
        Source of the scans, with a period of whole microseconds (`with_whole_period`); its error model has the drift
        of the clock and the faults of the link.
    seed : int
        Seed that the faults are drawn from.
    now : int
        Monotonic time [ns].
    counters : dict of str to int, optional
        Fault counters of a previous run, to continue.
    boot : int, default 0
        Number of the first power-on.

    Raises
    ------
    ConfigError
        The layout does not fit the frames.
    ValueError
        The scan period is not a whole number of microseconds.
    """

    def __init__(
        self, board: SimulatedBoard, seed: int, now: int, counters: dict[str, int] | None = None, boot: int = 0
    ) -> None:
        if with_whole_period(board.sensor) != board.sensor:
            raise ValueError(f"scan period must be whole microseconds, got a rate of {board.sensor.can.scan_rate} Hz")
        self.on_scan: Callable[[Scan], None] | None = None
        """Called with each scan that is sent, before link faults are applied."""
        self.switched_on = now
        """Time at which the board was switched on [ns]."""
        self.boot = boot
        """Number of the newest power-on."""
        self._board = board
        self._slow = 1 + board.error_model.clock_drift
        self._period = round(NANOSECONDS / board.sensor.can.scan_rate)
        self._missed = 0  # by firmware before the newest power-on
        self._missed_before = 0  # `missed` before the newest scan
        self._late = False  # whether scans were missed before the newest one
        self._offset = 0  # ticks from the first power-on to the newest
        self._scene_begin: int | None = None  # ticks from the first power-on to the beginning of the scene
        self._faults = LinkFaults(board.error_model, seed, counters)
        self._frames = 0
        self._firmware: BoardFirmware | None = self._switch_on(0.0, charge_reset=True)

    @property
    def counters(self) -> dict[str, int]:
        """Frames of scans by outcome other than delivered, and resets."""
        return self._faults.counters

    @property
    def missed(self) -> int:
        """Scans that were not made since the emulation was late."""
        return self._missed + (self._firmware.missed if self._firmware else 0)

    @property
    def running(self) -> bool:
        """Whether the board sends scans."""
        return self._firmware is not None and self._firmware.running

    @property
    def scene_begin(self) -> int:
        """Time at which the scene began [ns]: that of the scan that follows the first start command."""
        return self._host_time(self.switched_on + (self._scene_begin or 0) * self._period)

    def next_due(self) -> int:
        """Return when the next frame is due, or the board resets or restarts [ns].

        The caller is about to wait unless the board is late, so the next scan is computed here.
        """
        if self._firmware is None:
            return self._at(self._faults.running_since)
        if self._firmware.running and not self._late:
            self._board.prepare(self._board.index + 1)
        due = self._host_time(self._firmware.next_due()) + 1
        reset = self._faults.next_reset
        return min(due, self._at(reset)) if math.isfinite(reset) else due

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        """Return the frames that are due at `now` [ns].

        Parameters
        ----------
        now : int
            Monotonic time [ns].
        until : int, optional
            Time before `now` [ns]: what is due later is not returned yet, unless what is due by then was missed.

        Returns
        -------
        list of Frame
            Frames in the order in which they are sent.
        """
        self._update(now)
        if self._firmware is None:
            return []
        end = None if until is None else self._own_time(until)
        return [sent for frame in self._firmware.due(self._own_time(now), end) for sent in self._send(frame)]

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Process a frame from the bus at `now` [ns] and return the frames that answer it."""
        self._update(now)
        if self._firmware is None:
            return []
        answers = self._firmware.receive(frame, self._own_time(now))
        if self._firmware.running and self._scene_begin is None:
            self._scene_begin = self._offset + self._firmware.next_index
        return answers

    def _update(self, now: int) -> None:
        """Reset when it is time, and restart after the silence."""
        time = (now - self.switched_on) / NANOSECONDS
        if self._faults.reset_due(time):
            self._missed = self.missed
            self._firmware = None
        if self._firmware is None and time >= self._faults.running_since:
            self.boot += 1
            self._firmware = self._switch_on(self._faults.running_since)

    def _switch_on(self, time: float, charge_reset: bool = False) -> BoardFirmware:
        """Return fresh firmware of a board that starts `time` [s] after the first."""
        self._offset = math.ceil(time / self._slow * NANOSECONDS / self._period)
        start = self.switched_on + self._offset * self._period
        firmware = BoardFirmware(self._board.sensor, self, start, self.boot, charge_reset)
        firmware.on_scan = self._sent
        return firmware

    def scan(self, index: int, out: Scan) -> None:
        """Compute the scan of a tick since the newest power-on.

        Parameters
        ----------
        index : int
            Index of the tick.
        out : Scan
            Scan to fill in.
        """
        of_scene = index + self._offset - (self._scene_begin or 0)
        missed = self.missed
        self._late, self._missed_before = missed > self._missed_before, missed
        self._board.skip_to(of_scene, LATE_STEP if self._late else 0.0)
        self._board.scan(of_scene, out)

    def _sent(self, scan: Scan) -> None:
        if self.on_scan:
            self.on_scan(scan)

    def _send(self, frame: Frame) -> list[Frame]:
        """Return what arrives of a frame at the far end of the link."""
        identifier, kind, data = frame
        offset = identifier - self._board.sensor.can.base_id
        if offset not in _OF_SCANS and offset < CLASSIC_BLOCK_OFFSET:
            return [frame]
        outcome = self._faults.outcome(self._frames)
        self._frames += 1
        if outcome == TransmissionOutcome.DROPPED:
            return []
        if outcome == TransmissionOutcome.TRUNCATED:
            return [(identifier, kind, data[: (FD_LENGTH if kind & FD else CLASSIC_LENGTH) // 2])]
        return [frame, frame] if outcome == TransmissionOutcome.DUPLICATED else [frame]

    def _own_time(self, now: int) -> int:
        return self.switched_on + math.floor((now - self.switched_on) / self._slow)

    def _host_time(self, own: int) -> int:
        return self.switched_on + math.ceil((own - self.switched_on) * self._slow)

    def _at(self, time: float) -> int:
        return self.switched_on + math.ceil(time * NANOSECONDS)
