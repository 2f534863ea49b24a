# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Snapshots of a stack in one process, taken from its nodes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from posfet.snapshot import ContactView, Snapshot, TrueContact
from posfet_model.contacts.tracker import Contact, ContactState

if TYPE_CHECKING:
    from posfet_driver.ros.scan_source_node import ScanSourceNode
    from posfet_model.ros.model_node import ModelNode


def node_snapshot(model: ModelNode, source: ScanSourceNode, simulation: Any) -> Snapshot | None:
    """Return the newest snapshot of a stack, or None before the first scan.

    Parameters
    ----------
    model : ModelNode
        Node with the model.
    source : ScanSourceNode
        Node with the source of scans.
    simulation : SimBoardNode or None
        Node with the simulated board.
    """
    latest = model.latest()
    if latest is None:
        return None
    report = source.source.report()
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
        truth=_truth(simulation, latest.sequence),
        state=report.state,
        calibration=latest.calibration,
        standard_deviation=latest.standard_deviation.ravel(),
        status=latest.status.ravel(),
        total_standard_deviation=latest.total_standard_deviation,
        sequence=latest.sequence,
        stamp=latest.stamp,
    )


def _truth(simulation: Any, sequence: int) -> tuple[TrueContact, ...]:
    """Return the true contacts of a scan; with a bus in between, the model is some scans behind the board."""
    objects = None if simulation is None else simulation.objects_in(sequence)
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
