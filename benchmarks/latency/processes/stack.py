# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Driver and model in one process, composed as by `posfet bringup`: `python -m benchmarks.latency.processes.stack`.

Also records when the contacts of each scan were ready, just before they are published. Prints the losses at the end.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from benchmarks.latency.processes.recording import TimeLog
from posfet.composed_graph import Graph
from posfet.graph import NodeSpec
from posfet_model.ros.run_node import ros, spin

RECORDS: Final = 1 << 20
"""Most messages published without Python that are recorded."""


def record_publishing(model: Any, times: TimeLog) -> Callable[[], None]:
    """Record the time just before each contacts message is published; return what is called at the end.

    Messages that are published without Python are recorded without it: `recorded_publish.cpp` is called in the place of
    rcl's function.
    """
    publish = model._outputs.contacts.publish

    def recorded(message: Any) -> None:
        times.add(model._result.sequence)
        publish(message)

    model._outputs.contacts.publish = recorded
    functions = model._direct._functions
    if functions is None:
        return lambda: None
    with TemporaryDirectory() as folder:
        library = Path(folder) / "recorded_publish.so"
        source = Path(__file__).with_name("recorded_publish.cpp")
        subprocess.run(["g++", "-std=c++17", "-O2", "-shared", "-fPIC", source, "-o", library], check=True)
        shim = ctypes.CDLL(str(library))
    pairs = np.zeros((RECORDS, 2), np.int64)
    shim.record_into(
        ctypes.c_void_p(functions.publish),
        ctypes.c_size_t(sequence_place(model._outputs.frame_id)),
        pairs.ctypes.data_as(ctypes.c_void_p),
        ctypes.c_size_t(RECORDS),
    )
    shim.recorded.restype = ctypes.c_size_t
    address = ctypes.cast(shim.recorded_publish, ctypes.c_void_p).value
    model._direct._functions = functions._replace(publish=address)

    def finish() -> None:
        found = pairs[: shim.recorded()]
        times.extend(found[:, 0], found[:, 1])

    return finish


def sequence_place(frame_id: str) -> int:
    """Return where the sequence is in a serialised TactileContacts [byte]: behind stamp, frame and layout_id."""
    layout_id = -(-(12 + len(frame_id.encode()) + 1) // 4) * 4
    return 4 + -(-(layout_id + 4) // 8) * 8


def main() -> None:
    """Run until interrupted."""
    options = json.loads(sys.argv[1])
    sensor: dict[str, Any] = {"sensor_file": options["sensor_file"]}
    bus = {**sensor, "can_interface": "slcan", "can_channel": options["link"]}
    specs = [
        NodeSpec("posfet_model", "model_node", "tactile", options["params"], "warn", {**sensor, **options["model"]}),
        NodeSpec("posfet_driver", "driver_node", "tactile", options["params"], "warn", bus),
    ]
    times = TimeLog()
    with ros(["--ros-args", "--log-level", "warn"]) as stack:
        graph = Graph(specs)
        stack.callback(graph.destroy)
        finish = record_publishing(graph.nodes["model_node"], times)
        graph.start()
        print("ready", flush=True)
        spin(list(graph.nodes.values()))
        finish()
        report = graph.source.source.report()
        counts = {kind.label: count for kind, count in report.fault_counts.items()} | dict(report.counters)
        print(json.dumps({"scans": report.scans, "lost": report.frames_lost, **counts}), flush=True)
    times.write(Path(options["out"]))


if __name__ == "__main__":
    main()
