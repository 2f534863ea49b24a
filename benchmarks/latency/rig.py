# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Runs board, stack and listener as processes and combines their recordings."""

from __future__ import annotations

import json
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ament_index_python.packages import get_package_share_directory

from benchmarks.latency.processes import compiled_echo
from benchmarks.timing import processor_seconds
from posfet_model.config import find_file
from posfet_model.sensor.description import SENSOR_FOLDER

FOLDER = Path(__file__).parent
TOUCHED = str(FOLDER / "scenes" / "touched.yaml")
SETTLE = 1.3
"""Time from the first message to the measurement window [s]: the fingertip is in contact by then."""
START_TIMEOUT = 15.0
END_TIMEOUT = 8.0


@dataclass(frozen=True)
class Setup:
    """One measurement."""

    sensor: str = "posfet_5x5"
    rate: float = 1000.0
    touched: bool = True
    stack: str = "composed"
    """composed, separate, baseline, echo, or compiled echo."""
    as_bytes: bool = True
    """Whether contacts are passed to the middleware as serialised bytes."""
    window: float = 2.0
    """Length of the measurement window [s]."""
    fd: bool = True


@dataclass(frozen=True)
class Measurement:
    """Result of one measurement."""

    latency: np.ndarray[Any, Any]
    """From just before a scan was written by the adapter to its message in the other process [us]."""
    ready: np.ndarray[Any, Any]
    """To contacts computed [us], for the echo to its publish call; empty if separate or baseline."""
    cpu: float
    """Processor time of the stack over elapsed time [%]."""
    written: int
    """Scans that the adapter wrote in the window."""
    received: int
    """Those of them that were received as messages."""
    lost: int
    """Frames lost or dropped during the whole run, as counted by driver and adapter."""
    values: dict[str, float] = field(default_factory=dict)

    def at(self, percent: float) -> float:
        """Return a percentile of the latency [us]; infinite if nothing was received."""
        return float(np.percentile(self.latency, percent)) if len(self.latency) else float("inf")


class Process:
    """A process that reports its progress by lines on stdout."""

    def __init__(self, words: Sequence[str]) -> None:
        command = [sys.executable, *words]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=FOLDER.parents[1])

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def wait_for(self, word: str) -> None:
        """Wait for a line; raise RuntimeError if it does not appear in time."""
        assert self._process.stdout
        end = time.monotonic() + START_TIMEOUT
        while (left := end - time.monotonic()) > 0:
            if select.select([self._process.stdout], [], [], left)[0]:
                line = self._process.stdout.readline()
                if not line:
                    break
                if line.strip() == word:
                    return
        raise RuntimeError(f"{self._process.args}: no line '{word}'")

    def end(self) -> str:
        """Interrupt the process; return its last line."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        try:
            lines = self._process.communicate(timeout=END_TIMEOUT)[0].split("\n")
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            return ""
        return next((line for line in reversed(lines) if line), "")


def sensor_file(name: str, rate: float, fd: bool, folder: Path) -> str:
    """Write a shipped sensor file with another scan rate; return the path."""
    text = find_file(name, SENSOR_FOLDER, "sensor").read_text(encoding="utf-8")
    text = re.sub(r"scan_rate_Hz: [\d.]+", f"scan_rate_Hz: {rate:.1f}", text)
    text = re.sub(r"fd: (true|false)", f"fd: {str(fd).lower()}", text)
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def run(setup: Setup) -> Measurement:
    """Run one measurement. Raises RuntimeError if a process does not start."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        sensor = sensor_file(setup.sensor, setup.rate, setup.fd, folder)
        link = str(folder / "adapter")
        scene = TOUCHED if setup.touched else "idle"
        seconds = SETTLE + setup.window + 3.0
        words = [
            "-m",
            "benchmarks.latency.processes.board",
            sensor,
            scene,
            link,
            str(seconds),
            str(folder / "written.npy"),
        ]
        board = Process(words)
        stack.callback(board.end)
        listener = Process(["-m", "benchmarks.latency.processes.listener", str(folder / "received.npy")])
        stack.callback(listener.end)
        board.wait_for("ready")
        listener.wait_for("ready")
        processes = _start_stack(setup, sensor, link, folder)
        for process in processes:
            stack.callback(process.end)
        listener.wait_for("first")
        time.sleep(SETTLE)
        begin, used = time.monotonic_ns(), sum(processor_seconds(process.pid) for process in processes)
        time.sleep(setup.window)
        used = sum(processor_seconds(process.pid) for process in processes) - used
        finish = time.monotonic_ns()
        time.sleep(0.2)  # messages in transit
        output = [process.end() for process in processes]
        dropped = int(board.end() or 0)
        listener.end()
        return _join(folder, begin, finish, used, output[-1], dropped)


def _start_stack(setup: Setup, sensor: str, link: str, folder: Path) -> list[Process]:
    params = get_package_share_directory("posfet") + "/config/parameters.yaml"
    if setup.stack == "baseline":
        processes = [Process(["-m", "benchmarks.latency.baseline_stack.model_node", sensor])]
        processes.append(Process(["-m", "benchmarks.latency.baseline_stack.driver_node", sensor, link]))
        return processes
    if setup.stack == "echo":
        return [Process(["-m", "benchmarks.latency.processes.echo", link, sensor, f"{folder}/ready.npy"])]
    if setup.stack == "compiled echo":
        words = [str(compiled_echo.compiled()), link, sensor, f"{folder}/ready.npy"]
        return [Process(["-m", "benchmarks.latency.processes.compiled_echo", *words])]
    model = {} if setup.as_bytes else {"contacts_as_bytes": False}
    if setup.stack == "composed":
        options = {"sensor_file": sensor, "link": link, "params": params, "model": model, "out": f"{folder}/ready.npy"}
        process = Process(["-m", "benchmarks.latency.processes.stack", json.dumps(options)])
        return [process]
    common = ["--ros-args", "-r", "__ns:=/tactile", "--log-level", "warn", "-p", f"sensor_file:={sensor}"]
    bus = ["-p", "can_interface:=slcan", "-p", f"can_channel:={link}"]
    more = [word for key, value in model.items() for word in ("-p", f"{key}:={str(value).lower()}")]
    return [
        Process(["-c", "from posfet_model.ros.model_node import main; main()", *common, *more]),
        Process(["-c", "from posfet_driver.ros.driver_node import main; main()", *common, *bus]),
    ]


def _join(folder: Path, begin: int, finish: int, used: float, output: str, dropped: int) -> Measurement:
    """Match the times at which scans were written, ready and received, by sequence."""
    written = _times_by_sequence(folder / "written.npy")
    received = _times_by_sequence(folder / "received.npy")
    ready = _times_by_sequence(folder / "ready.npy")
    expected = [number for number, at in written.items() if begin <= at < finish]
    report = json.loads(output) if output.startswith("{") else {}
    return Measurement(
        latency=_delays(written, received, expected),
        ready=_delays(written, ready, expected),
        cpu=100 * used / ((finish - begin) * 1e-9),
        written=len(expected),
        received=sum(number in received for number in expected),
        lost=int(report.get("lost", 0)) + dropped,
        values={key: float(value) for key, value in report.items()},
    )


def _times_by_sequence(path: Path) -> dict[int, int]:
    if not path.exists():
        return {}
    rows = np.load(path)
    return dict(zip(rows[0].tolist(), rows[1].tolist(), strict=True))


def _delays(written: dict[int, int], then: dict[int, int], expected: Sequence[int]) -> np.ndarray[Any, Any]:
    return np.array([(then[number] - written[number]) * 1e-3 for number in expected if number in then])
