# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The graph in one process: the source of scans calls the model directly, without a message in between."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Final

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet.graph import NodeSpec
from posfet_driver.board.faults import Health
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.ros.model_node import ModelNode

if TYPE_CHECKING:
    from posfet.snapshot import Snapshot

CLASSES: Final = {
    "model_node": "ModelNode",
    "sim_board_node": "SimBoardNode",
    "driver_node": "DriverNode",
    "replay_node": "ReplayNode",
}
"""Class of each node, in the module with the name of its executable; only the nodes of the graph are imported."""


class Graph:
    """The nodes of one graph, connected within this process; iterates over them.

    Parameters
    ----------
    specs : sequence of NodeSpec
        Nodes; the source of scans is last.
    context : Context, optional
        Context of the nodes; None: the default one.

    Raises
    ------
    ConfigError
        If a parameter or file cannot be used.
    """

    def __init__(self, specs: Sequence[NodeSpec], context: Context | None = None) -> None:
        self.nodes: dict[str, Node] = {}
        """The nodes by the name of their executable."""
        try:
            for spec in specs:
                values = dict(spec.parameters)
                if spec.executable == "model_node":
                    values["direct"] = True
                module = import_module(f"{spec.package}.ros.{spec.executable}")
                self.nodes[spec.executable] = getattr(module, CLASSES[spec.executable])(
                    cli_args=spec.arguments,
                    use_global_arguments=False,
                    parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
                    context=context,
                )
        except BaseException:
            self.destroy()
            raise
        self.model: ModelNode = self.nodes["model_node"]
        """Node with the model."""
        self.source: ScanSourceNode = self.nodes[specs[-1].executable]
        """Node with the source of scans."""
        self.source.sink, self.source.stream = self.model.process, self.model.stream
        try:
            self.model.use_frame(self.source.frame_id)
        except BaseException:
            self.destroy()
            raise

    def __iter__(self) -> Iterator[Node]:
        return iter(self.nodes.values())

    @property
    def failure(self) -> str:
        """Why a node cannot go on after internal errors, in one line; '' while all can."""
        return next((node.failure for node in self.nodes.values() if node.failure), "")

    @property
    def finished(self) -> bool:
        """Whether the source has no more scans: a recording is over."""
        return bool(getattr(self.source.source, "finished", False))

    def ending(self) -> str:
        """Return how the source has finished, in one line; '' while it goes on, and if nothing was left out."""
        if not self.finished:
            return ""
        report = self.source.source.report()
        return "" if report.health == Health.OK else report.state

    def start(self) -> None:
        """Start the source of scans, then publish all topics; raise ConfigError if no retry would open the source."""
        for node in self.nodes.values():
            node.start()
        self.model.add_maps()

    def destroy(self) -> None:
        """Destroy the sources first, then the other nodes."""
        for node in reversed(self.nodes.values()):
            node.destroy_node()

    def state(self) -> str:
        """Return the state of the source of scans, in one line."""
        return self.source.source.report().state

    def snapshot(self) -> Snapshot | None:
        """Return the newest snapshot, or None before the first scan."""
        from posfet.node_snapshots import node_snapshot  # noqa: PLC0415  # loaded while scans are processed

        return node_snapshot(self.model, self.source, self.nodes.get("sim_board_node"))
