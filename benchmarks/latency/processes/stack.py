"""Driver and model in one process, as `posfet bringup` joins them: `python -m benchmarks.latency.processes.stack`.

Also notes when the contacts of each scan were ready, just before they are published. Prints what was lost in the end.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.latency.processes.recording import Moments
from posfet.composed_node import Graph
from posfet.graph import NodeSpec
from posfet_model.ros.run_node import ros, spin


def note(model: Any, moments: Moments) -> None:
    """Have the moment noted at which each contacts message is about to be published."""
    publish = model._contacts.publish

    def noted(message: Any) -> None:
        moments.add(model._result.sequence)
        publish(message)

    model._contacts.publish = noted


def main() -> None:
    """Run until told to end."""
    options = json.loads(sys.argv[1])
    sensor: dict[str, Any] = {"sensor_file": options["sensor_file"]}
    bus = {**sensor, "can_interface": "slcan", "can_channel": options["link"]}
    specs = [
        NodeSpec("posfet_model", "model_node", "tactile", options["params"], "warn", {**sensor, **options["model"]}),
        NodeSpec("posfet_driver", "driver_node", "tactile", options["params"], "warn", bus),
    ]
    moments = Moments()
    with ros(["--ros-args", "--log-level", "warn"]) as stack:
        graph = Graph(specs)
        stack.callback(graph.destroy)
        note(graph.nodes["model_node"], moments)
        graph.start()
        print("ready", flush=True)
        spin(list(graph.nodes.values()))
        report = graph._source.source.report()
        counts = {kind.label: count for kind, count in report.fault_counts.items()} | dict(report.counters)
        print(json.dumps({"scans": report.scans, "lost": report.frames_lost, **counts}), flush=True)
    moments.write(Path(options["out"]))


if __name__ == "__main__":
    main()
