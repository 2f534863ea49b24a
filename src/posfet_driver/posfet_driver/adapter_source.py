"""The simulated board behind an emulated CAN adapter: a driver reads it as it reads a device."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from posfet_driver.adapter import EmulatedAdapter
from posfet_driver.firmware import BoardFirmware
from posfet_driver.scene import Scene
from posfet_driver.simulated_board import SimulatedBoard
from posfet_driver.source import Clock, Health, SourceReport, SystemClock
from posfet_model.scan import Scan
from posfet_model.sensor import Sensor


class AdapterSource:
    """Switches a board and its adapter on and off, and tells what they do. `read` hands on nothing: the driver does.

    The scene starts when the board is switched on by `open`, the scans when a driver tells the board so.
    """

    def __init__(
        self,
        sensor: Sensor,
        scene: Scene,
        seed: int,
        link: Path | str,
        fd: bool | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Take what the board is made of, the path of the adapter, the frames (None: as in the sensor file), a clock.

        Raises ValueError for a seed outside [0, 1e9].
        """
        self.board = SimulatedBoard(sensor, scene, seed)
        """The board behind the adapter; another one after each `open`."""
        self.on_scan: Callable[[Scan, int], None] | None = None
        """Called in the adapter's thread with each scan sent and its time [ns] since the Unix epoch."""
        self._seed = seed
        self._link = link
        self._fd = fd
        self._clock = clock or SystemClock()
        self._firmware: BoardFirmware | None = None
        self._adapter: EmulatedAdapter | None = None
        self._epoch = 0
        self._scans = 0
        self._dropped = 0  # by adapters that are closed

    @property
    def simulated(self) -> bool:
        """True: the signals come from a model."""
        return True

    def open(self) -> None:
        """Switch the board on and put the adapter in its place.

        Raises ConfigError when the layout does not fit the frames, SourceError when the adapter cannot be put there.
        """
        self.board = SimulatedBoard(self.board.sensor, self.board.scene, self._seed)
        firmware = BoardFirmware(self.board.sensor, self.board, self._clock.monotonic(), self._fd)
        firmware.on_scan = self._sent
        self._epoch = self._clock.wall() - self._clock.monotonic()
        adapter = EmulatedAdapter(self._link, firmware, self._clock)
        adapter.open()
        self._firmware, self._adapter = firmware, adapter

    def read(self, timeout: float) -> Scan | None:
        """Let `timeout` [s] pass and return None."""
        self._clock.sleep(timeout)
        return None

    def close(self) -> None:
        """Take the adapter away and switch the board off."""
        if self._adapter:
            self._adapter.close()
            self._dropped += self._adapter.frames_dropped
        self._firmware = self._adapter = None

    def report(self) -> SourceReport:
        """Return the state for diagnostics; the scans are those that the board sent."""
        firmware, adapter = self._firmware, self._adapter
        if firmware is None or adapter is None:
            health, state = Health.STALE, "simulation stopped"
        elif firmware.running:
            health, state = Health.OK, f"simulating scene '{self.board.scene.name}' on the adapter {self._link}"
        else:
            health, state = Health.OK, f"waiting on the adapter {self._link} for a driver to start the scans"
        dropped = self._dropped + (adapter.frames_dropped if adapter else 0)
        return SourceReport(
            health=health,
            state=state,
            scans=self._scans,
            frames_lost=dropped,
            counters={"frames nobody read": dropped},
            values={"scene": self.board.scene.name},
        )

    def _sent(self, scan: Scan) -> None:
        self._scans += 1
        if self.on_scan and self._firmware:
            self.on_scan(scan, self._epoch + self._firmware.switched_on + scan.stamp)
