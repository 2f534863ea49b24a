# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The graph in one process: the source of scans calls the model directly, without a message in between."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any, Final

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet.graph import NodeSpec
from posfet.snapshot import ContactView, Snapshot, TrueContact
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.contacts.tracker import Contact, ContactState
from posfet_model.ros.model_node import ModelNode

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
        self._model: ModelNode = self.nodes["model_node"]
        self._simulation: Any = self.nodes.get("sim_board_node")
        self._source: ScanSourceNode = self.nodes[specs[-1].executable]
        self._source.sink, self._source.stream = self._model.process, self._model.stream
        try:
            self._model.use_frame(self._source.frame_id)
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
        return bool(getattr(self._source.source, "finished", False))

    def start(self) -> None:
        """Start the source of scans; raise ConfigError if it cannot be opened and a retry would not help."""
        for node in self.nodes.values():
            node.start()

    def destroy(self) -> None:
        """Destroy the sources first, then the other nodes."""
        for node in reversed(self.nodes.values()):
            node.destroy_node()

    def snapshot(self) -> Snapshot | None:
        """Return the newest snapshot, or None before the first scan."""
        latest = self._model.latest()
        if latest is None:
            return None
        report = self._source.source.report()
        rows, cols = latest.force.shape
        return Snapshot(
            time=time.monotonic(),
            scans=latest.scans,
            frames_lost=report.frames_lost,
            scans_lost=latest.missed,
            rows=rows,
            cols=cols,
            force=latest.force.ravel(),
            total_force=latest.total,
            data_valid=latest.valid,
            contacts=tuple(_view(contact) for contact in latest.contacts if contact.state != ContactState.RELEASED),
            truth=self._truth(latest.sequence),
            state=report.state,
            calibration=latest.calibration,
            standard_deviation=latest.standard_deviation.ravel(),
            status=latest.status.ravel(),
            total_standard_deviation=latest.total_standard_deviation,
            sequence=latest.sequence,
            stamp=latest.stamp,
        )

    def state(self) -> str:
        """Return the state of the source of scans, in one line."""
        return self._source.source.report().state

    def _truth(self, sequence: int) -> tuple[TrueContact, ...]:
        """Return the true contacts of a scan; with a bus in between, the model is some scans behind the board."""
        objects = None if self._simulation is None else self._simulation.objects_in(sequence)
        if objects is None:
            return ()
        touching = zip(objects.contact_centres.tolist(), objects.contact_forces.tolist(), strict=True)
        return tuple(TrueContact(x, y, force) for (x, y), force in touching)


def _view(contact: Contact) -> ContactView:
    region = contact.region
    x, y = region.centre_of_pressure
    return ContactView(
        id=contact.id,
        state=contact.state.name.lower(),
        x=x,
        y=y,
        force=region.force,
        standard_deviation=region.force_variance**0.5,
        area=region.area,
        age=contact.age,
        major_axis=region.major_axis,
        minor_axis=region.minor_axis,
        velocity=contact.velocity,
    )
