# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Work that the stack leaves out: labelling of contacts where the touched taxels did not change."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_model.contacts.detection import ContactFinder
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()
SCENES = ("idle", "tap", "slide", "texture")
SETTLED, SCANS = 300, 1500
"""Scans of a scene that are left out at its start, and that are used."""


Label = Callable[[ContactFinder, Array], object]


def measure(effort: Effort) -> list[Front]:
    """Return the front of labelling."""
    return [_labelling(200 if effort.short else SCANS, effort)]


def recorded(scene: str, scans: int) -> tuple[list[Scan], list[Array]]:
    """Return the scans of a scene after its start, and the forces that the stack estimates from them [N]."""
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene(scene, SENSOR), SENSOR), 0, ErrorModel.none())
    reconstructor, scan = Reconstructor(SENSOR), Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    kept, forces = [], []
    for index in range(SETTLED + scans):
        board.scan(index, scan)
        reconstructor.process(scan)
        if index >= SETTLED:
            kept.append(scan.snapshot())
            forces.append(reconstructor._estimator.force.copy())
    return kept, forces


def _if_changed(finder: ContactFinder, force: Array) -> object:
    return finder.find(force)


def _always(finder: ContactFinder, force: Array) -> object:
    finder._mask = b""  # no scan is like the last one
    return finder.find(force)


def _regions(label: Label, finder: ContactFinder, force: Array) -> set[frozenset[int]]:
    label(finder, force)
    return {frozenset(each.region.taxels.tolist()) for each in finder._regions}


def _flooded(finder: ContactFinder, force: Array) -> set[frozenset[int]]:
    """Return the 8-connected regions of the touched taxels of a finder, by a flood over a plain set."""
    rest, cols, found = set(np.flatnonzero(force >= finder._limit).tolist()), SENSOR.layout.cols, set()
    while rest:
        group, edge = set[int](), {rest.pop()}
        while edge:
            taxel = edge.pop()
            group.add(taxel)
            near = {
                each for each in rest if max(abs(each // cols - taxel // cols), abs(each % cols - taxel % cols)) <= 1
            }
            rest -= near
            edge |= near
        found.add(frozenset(group))
    return found


def _labelling(scans: int, effort: Effort) -> Front:
    """Compare labelling in every scan with labelling where the set of touched taxels changes."""
    forces = {name: recorded(name, scans)[1] for name in (SCENES[1:2] if effort.short else SCENES)}
    ways: dict[str, Label] = {"where the touched taxels change": _if_changed, "in every scan": _always}
    wrong, labelled = dict.fromkeys(ways, 0), dict.fromkeys(ways, 0)
    for images in forces.values():
        finders = {name: ContactFinder(SENSOR) for name in ways}
        for force in images:
            wanted = _flooded(finders["in every scan"], force)
            for name, way in ways.items():
                before = finders[name]._mask
                wrong[name] += _regions(way, finders[name], force) != wanted
                labelled[name] += way is _always or finders[name]._mask != before
    calls = {
        f"{way}|{scene}": (lambda label=label, images=images: _through(label, images))
        for way, label in ways.items()
        for scene, images in forces.items()
    }
    seconds = interleaved(calls, effort.repeats)
    total = scans * len(forces)
    whole = {
        way: tuple(sum(seconds[f"{way}|{scene}"][k] for scene in forces) / total for k in range(effort.repeats))
        for way in ways
    }
    unit = float(np.median(whole["where the touched taxels change"]))
    choices = tuple(
        Choice(way, "", 100 * wrong[way] / total, whole[way], (
            100 * labelled[way] / total,
            *(float(np.median(seconds[f"{way}|{scene}"])) / scans / unit for scene in forces),
        )) for way in ways
    )  # fmt: skip
    own, other = choices
    return Front(
        "skipped_labelling",
        "Skipped work, labelling of contacts",
        f"the regions of one scan, mean of the scenes {', '.join(forces)}",
        "scans with wrong regions [%]",
        "flood fill over the same touched taxels, 8-connected",
        0.0,
        choices,
        own.name,
        (
            Check("scans with wrong regions where labelling is skipped [%]", own.error, 0.0, 0.0),
            Check("scans in which it is not skipped [%]", own.more[0], 0.0, 100.0),
        ),
        f"Regions are labelled in {shown(own.more[0])} % of the scans, in {shown(own.median / other.median)} of the "
        "run time of labelling all of them. No region differs: skipping costs the comparison of two byte strings and "
        "no error.",
        why_not="Where the touched taxels change in every scan the comparison saves nothing.",
        question="the regions in contact",
        rival=other.name,
        swept=False,
        columns=("labelled %", *(f"run time, {scene}" for scene in forces)),
    )


def _through(label: Label, images: Sequence[Array]) -> None:
    finder = ContactFinder(SENSOR)
    for force in images:
        label(finder, force)
