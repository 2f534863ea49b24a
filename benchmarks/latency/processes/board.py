# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board behind the emulated adapter that records when each scan is written: `python -m` this module.

Its scans are computed in advance, so that the processor is free for the stack. Ends on SIGTERM or SIGINT.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np

from benchmarks.latency.processes.recording import TimeLog
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from posfet_sim.scene import SceneLoads, load_scene


class Replay:
    """Replays the scans of a scene, starting with the first request; the last scan repeats at the end."""

    def __init__(self, sensor: Sensor, scene: str, seconds: float) -> None:
        board = SimulatedBoard(sensor, SceneLoads(load_scene(scene, sensor), sensor), 1)
        count = round(seconds * sensor.can.scan_rate)
        self._counts = np.zeros((count, sensor.layout.taxels), np.uint16)
        scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        for index in range(count):
            board.scan(index, scan)
            self._counts[index] = scan.counts
        self._temperatures = scan.temperatures
        self._microseconds = 1e6 / sensor.can.scan_rate
        self._first = -1

    def scan(self, index: int, out: Scan) -> None:
        """Fill `out` with one scan."""
        if self._first < 0:
            self._first = index
        out.counts[:] = self._counts[min(index - self._first, len(self._counts) - 1)]
        out.temperatures[:] = self._temperatures
        out.device_time = round(index * self._microseconds)
        out.status = ScanStatus.OK


class StampingAdapter(EmulatedAdapter):
    """Records the time just before the bytes of each scan are written to the terminal."""

    def __init__(self, link: str, firmware: BoardFirmware) -> None:
        super().__init__(link, firmware)
        self.times = TimeLog()
        self._unstamped: list[int] = []
        firmware.on_scan = lambda scan: self._unstamped.append(scan.sequence)

    def _flush(self, master: int) -> None:
        for sequence in self._unstamped:
            self.times.add(sequence)
        self._unstamped.clear()
        super()._flush(master)


def main() -> None:
    """Serve the adapter until interrupted."""
    sensor_file, scene, link, seconds, out = sys.argv[1:]
    sensor = load_sensor(sensor_file)
    replay = Replay(sensor, scene, float(seconds))
    adapter = StampingAdapter(link, BoardFirmware(sensor, replay, time.monotonic_ns()))
    adapter.speeds = ()
    end = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: end.set())
    adapter.open()
    print("ready", flush=True)
    end.wait()
    adapter.close()
    adapter.times.write(Path(out))
    print(adapter.frames_dropped, flush=True)


if __name__ == "__main__":
    main()
