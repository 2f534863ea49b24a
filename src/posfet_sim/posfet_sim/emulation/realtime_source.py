"""Scans of a simulated board in real time, as a driver would hand them on."""

from __future__ import annotations

from typing import Final

from posfet_driver.board.faults import Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.clock import Clock, SystemClock
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.line_faults import FaultyScans
from posfet_sim.scene import Scene, SceneLoads

_NANOSECONDS: Final = 1_000_000_000
LATE: Final = 0.1
"""Delay [s] from which a source says that the machine cannot keep up."""


class SimulationSource:
    """Hands on each scan of a board when the board takes it.

    What a scan needs is computed while it is waited for. A reader that comes late gets every scan that is due, one
    after the other: none is skipped, and the stamps keep the board's rhythm. Scans that the board's line loses are
    missing, those it repeats come twice (`FaultyScans`). After a `close` the next `open` starts a fresh board.
    """

    def __init__(
        self,
        sensor: Sensor,
        scene: Scene,
        seed: int,
        clock: Clock | None = None,
        imperfections: Imperfections | None = None,
    ) -> None:
        """Take what the board is made of (see `SimulatedBoard`), and the clock (that of this machine by default).

        Raises ValueError for a seed outside [0, 1e9].
        """
        self.scene = scene
        """The scene that the next `open` begins with."""
        self.board = SimulatedBoard(sensor, SceneLoads(scene, sensor), seed, imperfections)
        """The board that the scans come from, for its ground truth; another one after each `open`."""
        self._scans = FaultyScans(self.board, seed)
        self._again = False  # whether the last scan is to be handed on once more
        self._seed = seed
        self._clock = clock or SystemClock()
        self._scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self._running = False
        self._start = 0
        self._epoch = 0
        self._next = 0
        self._delivered = 0
        self._delay = 0.0

    @property
    def simulated(self) -> bool:
        """True: the signals come from a model."""
        return True

    def open(self) -> None:
        """Put a fresh board at the beginning of `scene`, which the first `read` starts."""
        board = self.board
        self.board = SimulatedBoard(board.sensor, SceneLoads(self.scene, board.sensor), self._seed, board.imperfections)
        counters = self._scans.counters  # go on counting
        self._scans = FaultyScans(self.board, self._seed)
        self._scans.counters = counters
        self._again = False
        self._next = 0
        self._delay = 0.0
        self._running = True

    def read(self, timeout: float) -> Scan | None:
        """Return the next scan when it is due within `timeout` [s], else None after that time.

        The first call starts the scene: scan 0 is due at once.
        """
        if self._next == 0:
            self._start = self._clock.monotonic()
            self._epoch = self._clock.wall()
        if self._again:
            self._again = False
            self._delivered += 1
            return self._scan
        end = self._clock.monotonic() + round(timeout * _NANOSECONDS)
        while True:
            due = self._start + round(self.board.clock.time(self._next) * _NANOSECONDS)
            now = self._clock.monotonic()
            if due > now:
                self.board.prepare(self._next)
                now = self._clock.monotonic()
                self._clock.sleep(max(min(due, end) - now, 0) / _NANOSECONDS)
                if due > end:
                    return None
            self._delay = max(now - due, 0) / _NANOSECONDS
            times = self._scans.scan(self._next, self._scan)
            self._next += 1
            if times:
                self._scan.stamp += self._epoch
                self._again = times > 1
                self._delivered += 1
                return self._scan

    def close(self) -> None:
        """Stop the scene."""
        self._running = False

    def report(self) -> SourceReport:
        """Return the state for diagnostics."""
        if not self._running:
            health, state = Health.STALE, "simulation stopped"
        elif self._next == 0:
            health, state = Health.OK, f"scene '{self.board.loads.name}' waits for its first listener"
        elif self._delay > LATE:
            health, state = Health.WARN, "simulation late: this machine cannot keep up with the scan rate"
        else:
            health, state = Health.OK, f"simulating scene '{self.board.loads.name}'"
        return SourceReport(
            health=health,
            state=state,
            scans=self._delivered,
            frames_lost=0,
            counters={f"simulated: {name}": count for name, count in self._scans.counters.items() if count},
            values={"scene": self.board.loads.name, "delay [ms]": f"{self._delay * 1e3:.1f}"},
        )
