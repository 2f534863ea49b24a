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

import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.latency.processes.recording import TimeLog
from posfet.composed_node import Graph
from posfet.graph import NodeSpec
from posfet_model.ros.run_node import ros, spin


def record_publishing(model: Any, times: TimeLog) -> None:
    """Record the time just before each contacts message is published."""
    publish = model._outputs.contacts.publish

    def recorded(message: Any) -> None:
        times.add(model._result.sequence)
        publish(message)

    model._outputs.contacts.publish = recorded


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
        record_publishing(graph.nodes["model_node"], times)
        graph.start()
        print("ready", flush=True)
        spin(list(graph.nodes.values()))
        report = graph._source.source.report()
        counts = {kind.label: count for kind, count in report.fault_counts.items()} | dict(report.counters)
        print(json.dumps({"scans": report.scans, "lost": report.frames_lost, **counts}), flush=True)
    times.write(Path(options["out"]))


if __name__ == "__main__":
    main()
