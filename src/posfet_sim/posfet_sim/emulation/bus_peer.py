# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board as a peer on a CAN bus or behind an emulated adapter: a driver reads it like a real board."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.bus.open_bus import BusSettings
from posfet_driver.clock import Clock, SystemClock
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.bus_server import BusServer
from posfet_sim.emulation.firmware import with_whole_period
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from posfet_sim.scene import Scene, SceneLoads


class SimulatedBusPeer:
    """A simulated board together with its connection to the bus, from `open` to `close`.

    `open` switches a fresh board on. The scene and the scans start when a driver sends the start command. The peer
    sends its scans as frames; it is no source of scans itself.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    scene : Scene
        Scene that the board simulates.
    seed : int
        Seed of everything random, in [0, 1e9].
    link : Path, str or BusSettings
        Path at which the emulated slcan adapter appears, or the settings of a bus.
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
        link: Path | str | BusSettings,
        clock: Clock | None = None,
        error_model: ErrorModel | None = None,
    ) -> None:
        self.scene = scene
        """Scene of the next `open`."""
        self.board = SimulatedBoard(with_whole_period(sensor), SceneLoads(scene, sensor), seed, error_model)
        """The simulated board; each `open` makes another one."""
        self.on_scan: Callable[[Scan, int], None] | None = None
        """Called in the thread that serves the bus with each scan sent and its time [ns] since the Unix epoch."""
        self._seed = seed
        self._link = link
        self._clock = clock or SystemClock()
        self._node: BusBoard | None = None
        self._server: EmulatedAdapter | BusServer | None = None
        self._epoch = 0
        self._scans = 0
        self._faults: dict[str, int] | None = None
        self._boot = 0  # number of the next power-on
        self._dropped = 0  # by adapters that are closed
        self._missed = 0  # by boards that are switched off

    def open(self) -> None:
        """Switch a fresh board on, at the beginning of `scene`, and connect it.

        Raises
        ------
        ConfigError
            The layout does not fit the frames, or the settings of the bus are invalid.
        SourceError
            The adapter or the bus cannot be opened.
        """
        board = self.board
        self.board = SimulatedBoard(board.sensor, SceneLoads(self.scene, board.sensor), self._seed, board.error_model)
        node = BusBoard(self.board, self._seed, self._clock.monotonic(), self._faults, self._boot)
        node.on_scan = self._sent
        self._faults = node.counters
        self._epoch = self._clock.wall() - self._clock.monotonic()
        server: EmulatedAdapter | BusServer
        if isinstance(self._link, BusSettings):
            server = BusServer(self._link, node, self._clock)
        else:
            server = EmulatedAdapter(self._link, node, self._clock)
        server.open()
        self._node, self._server = node, server

    def close(self) -> None:
        """Disconnect the board and switch it off; may be called twice."""
        if self._server:
            self._server.close()
            self._dropped += self._server.frames_dropped
        if self._node:
            self._boot = self._node.boot + 1
            self._missed += self._node.missed
        self._node = self._server = None

    def report(self) -> SourceReport:
        """Return the state for diagnostics; its scans are those that the board sent."""
        node, server = self._node, self._server
        place = f"bus {self._link.name}" if isinstance(self._link, BusSettings) else f"adapter {self._link}"
        failure = server.failure if server else ""
        disconnected = server.disconnected if isinstance(server, BusServer) else ""
        if node is None or server is None:
            health, state = Health.STALE, "simulation stopped"
        elif failure:
            health, state = Health.ERROR, f"simulated board on the {place} has ended: {failure}"
        elif disconnected:
            health, state = Health.ERROR, f"{place} disconnected, retrying: {disconnected}"
        elif node.running:
            health, state = Health.OK, f"simulating scene '{self.board.loads.name}' on the {place}"
        else:
            health, state = Health.OK, f"waiting on the {place} for a driver to start the scans"
        dropped = self._dropped + (server.frames_dropped if server else 0)
        faults = {f"simulated: {name}": count for name, count in (self._faults or {}).items() if count}
        return SourceReport(
            health=health,
            state=state,
            scans=self._scans,
            frames_lost=dropped,
            fault_counts={FaultKind.SCAN_OVERRUN: self._missed + (node.missed if node else 0)},
            counters={"frames not read": dropped, **faults},
            values={"scene": self.board.loads.name},
            failure=failure,
        )

    def _sent(self, scan: Scan) -> None:
        self._scans += 1
        if self.on_scan and self._node:
            self.on_scan(scan, self._epoch + self._node.scene_begin + scan.stamp)
