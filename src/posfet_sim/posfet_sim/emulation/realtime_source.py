# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of a simulated board in real time, as a driver delivers them."""

from __future__ import annotations

from typing import Final

from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.clock import Clock, SystemClock
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.backlog import LATE, LATE_STEP, LONGEST_BACKLOG, STOPPED
from posfet_sim.emulation.faulty_scans import FaultyScans
from posfet_sim.scene import Scene, SceneLoads

_BEGIN: Final = int(ScanStatus.BOARD_RESET | ScanStatus.CHARGE_RESET)


class SimulationSource:
    """Delivers each scan of a board at its sampling time.

    The next scan is computed while the reader waits for it. A late reader gets the scans that are due one after the
    other, with STATUS_SCAN_OVERRUN from a delay of LATE on. Those later than LONGEST_BACKLOG are missed, which is
    counted; after a stop, all but the newest. The stamps are the sampling times. Scans that the board's link loses are
    missing, duplicates come twice (`FaultyScans`). Each `open` starts a fresh board, whose film does not remember the
    loads before; the first scan says so.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    scene : Scene
        Scene that the board simulates.
    seed : int
        Seed of everything random, in [0, 1e9].
    clock : Clock, optional
        Default: the clock of this machine.
    error_model : ErrorModel, optional
        Default: an ideal board.

    Raises
    ------
    ValueError
        The seed is out of range.
    """

    def __init__(
        self,
        sensor: Sensor,
        scene: Scene,
        seed: int,
        clock: Clock | None = None,
        error_model: ErrorModel | None = None,
    ) -> None:
        self.scene = scene
        """Scene of the next `open`."""
        self.board = SimulatedBoard(sensor, SceneLoads(scene, sensor), seed, error_model)
        """The simulated board, for its ground truth; each `open` makes another one."""
        self._scans = FaultyScans(self.board, seed)
        self._repeat = False  # whether the last scan is delivered once more
        self._seed = seed
        self._clock = clock or SystemClock()
        self._scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self._running = False
        self._begins = False  # whether the next scan delivered is the first of a board
        self._start = 0
        self._epoch = 0
        self._next = 0
        self._delivered = 0
        self._missed = 0
        self._overrun = False  # scans were missed since the newest one
        self._delay = 0.0

    @property
    def simulated(self) -> bool:
        """True: the signals come from a model."""
        return True

    def open(self) -> None:
        """Create a fresh board at the beginning of `scene`, which the first `read` starts."""
        board = self.board
        self.board = SimulatedBoard(board.sensor, SceneLoads(self.scene, board.sensor), self._seed, board.error_model)
        self._scans = FaultyScans(self.board, self._seed, self._scans.counters)
        self._repeat = self._overrun = False
        self._next = 0
        self._delay = 0.0
        self._running = self._begins = True

    def read(self, timeout: float) -> Scan | None:
        """Return the next scan if it is due within `timeout` [s], else None after that time.

        The first call starts the scene: scan 0 is due at once. The next call overwrites the scan.

        Parameters
        ----------
        timeout : float
            Longest wait [s].
        """
        if self._next == 0:
            self._start = self._clock.monotonic()
            self._epoch = self._clock.wall()
        if self._repeat:
            self._repeat = False
            self._delivered += 1
            return self._scan
        end = self._clock.monotonic() + round(timeout * NANOSECONDS)
        while True:
            due = self._start + round(self.board.clock.time(self._next) * NANOSECONDS)
            now = self._clock.monotonic()
            if due > now:
                self.board.prepare(self._next)
                now = self._clock.monotonic()
                self._clock.sleep(max(min(due, end) - now, 0) / NANOSECONDS)
                if due > end:
                    return None
            self._delay = max(now - due, 0) / NANOSECONDS
            if self._delay > LONGEST_BACKLOG:
                self._miss(now)
            times = self._scans.scan(self._next, self._scan)
            self._next += 1
            if times:
                self._scan.stamp += self._epoch
                if self._overrun or self._delay > LATE:
                    self._scan.status |= ScanStatus.SCAN_OVERRUN
                self._overrun = False
                if self._begins:
                    self._begins = False
                    self._scan.status |= _BEGIN
                self._repeat = times > 1
                self._delivered += 1
                return self._scan

    def _miss(self, now: int) -> None:
        """Miss the scans that are too late at `now` [ns]."""
        since, clock = (now - self._start) / NANOSECONDS, self.board.clock
        newest = clock.last_by(since)
        oldest = newest if self._delay > STOPPED else min(clock.last_by(since - LONGEST_BACKLOG) + 1, newest)
        missed = max(oldest - self._next, 0)
        self._next += missed
        self._missed += missed
        self._overrun |= missed > 0
        self._delay = max(since - clock.time(self._next), 0.0)
        self.board.skip_to(self._next, LATE_STEP)

    def close(self) -> None:
        """Stop the scene."""
        self._running = False

    def report(self) -> SourceReport:
        """Return the state for diagnostics."""
        if not self._running:
            health, state = Health.STALE, "simulation stopped"
        elif self._next == 0:
            health, state = Health.OK, f"scene '{self.board.loads.name}' waiting for the first subscriber"
        elif self._delay > LATE:
            health, state = Health.WARN, "simulation late: this machine is too slow for the scan rate"
        else:
            health, state = Health.OK, f"simulating scene '{self.board.loads.name}'"
        return SourceReport(
            health=health,
            state=state,
            scans=self._delivered,
            frames_lost=0,
            fault_counts={FaultKind.SCAN_OVERRUN: self._missed},
            conditions=(FaultKind.SCAN_OVERRUN,) if self._running and self._delay > LATE else (),
            counters={f"simulated: {name}": count for name, count in self._scans.counters.items() if count},
            values={"scene": self.board.loads.name, "delay [ms]": f"{self._delay * 1e3:.1f}"},
        )
