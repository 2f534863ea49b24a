"""The simulated board on a CAN bus or behind an emulated adapter: a driver reads it as it reads a device."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from posfet_driver.board.faults import Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.bus.open_bus import BusSettings
from posfet_driver.clock import Clock, SystemClock
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import WireNode
from posfet_sim.emulation.bus_server import BusServer
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from posfet_sim.scene import Scene, SceneLoads


class AdapterSource:
    """Switches a board and its way to the bus on and off, and tells what they do. `read` hands on nothing.

    The scene starts when the board is switched on by `open`, the scans when a driver tells the board so.
    """

    def __init__(
        self,
        sensor: Sensor,
        scene: Scene,
        seed: int,
        link: Path | str | BusSettings,
        clock: Clock | None = None,
        imperfections: Imperfections | None = None,
    ) -> None:
        """Take what the board is made of, and the path of the adapter or the settings of a bus.

        Raises ValueError for a seed outside [0, 1e9].
        """
        self.scene = scene
        """The scene that the next `open` begins with."""
        self.board = SimulatedBoard(sensor, SceneLoads(scene, sensor), seed, imperfections)
        """The board behind the adapter; another one after each `open`."""
        self.on_scan: Callable[[Scan, int], None] | None = None
        """Called in the thread that serves the bus with each scan sent and its time [ns] since the Unix epoch."""
        self._seed = seed
        self._link = link
        self._clock = clock or SystemClock()
        self._node: WireNode | None = None
        self._server: EmulatedAdapter | BusServer | None = None
        self._epoch = 0
        self._scans = 0
        self._faults: dict[str, int] = {}
        self._dropped = 0  # by adapters that are closed

    @property
    def simulated(self) -> bool:
        """True: the signals come from a model."""
        return True

    def open(self) -> None:
        """Switch a fresh board on, at the beginning of `scene`, and put it in its place.

        Raises ConfigError when the layout does not fit the frames or the bus cannot be, SourceError when the adapter
        or the bus cannot be opened.
        """
        board = self.board
        self.board = SimulatedBoard(board.sensor, SceneLoads(self.scene, board.sensor), self._seed, board.imperfections)
        node = WireNode(self.board, self._seed, self._clock.monotonic())
        node.on_scan = self._sent
        self._faults = node.counters = self._faults or node.counters  # go on counting
        self._epoch = self._clock.wall() - self._clock.monotonic()
        server: EmulatedAdapter | BusServer
        if isinstance(self._link, BusSettings):
            server = BusServer(self._link, node, self._clock)
        else:
            server = EmulatedAdapter(self._link, node, self._clock)
        server.open()
        self._node, self._server = node, server

    def read(self, timeout: float) -> Scan | None:
        """Let `timeout` [s] pass and return None."""
        self._clock.sleep(timeout)
        return None

    def close(self) -> None:
        """Take the board away from its bus and switch it off."""
        if self._server:
            self._server.close()
            self._dropped += self._server.frames_dropped
        self._node = self._server = None

    def report(self) -> SourceReport:
        """Return the state for diagnostics; the scans are those that the board sent."""
        node, server = self._node, self._server
        place = f"bus {self._link.name}" if isinstance(self._link, BusSettings) else f"adapter {self._link}"
        gone = server.gone if isinstance(server, BusServer) else ""
        if node is None or server is None:
            health, state = Health.STALE, "simulation stopped"
        elif gone:
            health, state = Health.ERROR, f"the {place} is gone: {gone}"
        elif node.running:
            health, state = Health.OK, f"simulating scene '{self.board.loads.name}' on the {place}"
        else:
            health, state = Health.OK, f"waiting on the {place} for a driver to start the scans"
        dropped = self._dropped + (server.frames_dropped if server else 0)
        faults = {f"simulated: {name}": count for name, count in self._faults.items() if count}
        return SourceReport(
            health=health,
            state=state,
            scans=self._scans,
            frames_lost=dropped,
            counters={"frames nobody read": dropped, **faults},
            values={"scene": self.board.loads.name},
        )

    def _sent(self, scan: Scan) -> None:
        self._scans += 1
        if self.on_scan and self._node:
            self.on_scan(scan, self._epoch + self._node.switched_on + scan.stamp)
