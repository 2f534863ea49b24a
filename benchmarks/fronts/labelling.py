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
from reference.contacts import detection as reference

SENSOR = load_sensor()
SCENES = ("idle", "tap", "slide", "texture")
SETTLED, SCANS = 300, 1500
"""Scans of a scene that are left out at its start, and that are used."""


Regions = set[frozenset[int]]
COMPILED, PLAIN = "compiled, where the touched taxels change", "plain Python, in every scan"


class Compiled:
    """The labelling of this stack."""

    def __init__(self) -> None:
        self._finder = ContactFinder(SENSOR)

    def __call__(self, force: Array) -> None:
        """Find the regions of a scan."""
        self._finder.find(force)

    def regions(self) -> Regions:
        """Return the taxels of each region of the last scan."""
        return {frozenset(region.tolist()) for region in self._finder.regions}


class Plain:
    """Bit operations on one integer of Python, for every scan."""

    def __init__(self) -> None:
        self._finder = reference.ContactFinder(SENSOR)

    def __call__(self, force: Array) -> None:
        """Find the regions of a scan."""
        self._finder._mask = b""  # no scan is like the last one
        self._finder.find(force)

    def regions(self) -> Regions:
        """Return the taxels of each region of the last scan."""
        return {frozenset(each.region.taxels.tolist()) for each in self._finder._regions}

    def flooded(self, force: Array) -> Regions:
        """Return the 8-connected regions of the taxels that the next call finds touched, by a flood over a set."""
        rest, cols, found = set(np.flatnonzero(force >= self._finder._limit).tolist()), SENSOR.layout.cols, set()
        while rest:
            group, edge = set[int](), {rest.pop()}
            while edge:
                taxel = edge.pop()
                group.add(taxel)
                near = {
                    each
                    for each in rest
                    if max(abs(each // cols - taxel // cols), abs(each % cols - taxel % cols)) <= 1
                }
                rest -= near
                edge |= near
            found.add(frozenset(group))
        return found


Label = Callable[[], "Compiled | Plain"]
WAYS: dict[str, Label] = {COMPILED: Compiled, PLAIN: Plain}


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


def _labelling(scans: int, effort: Effort) -> Front:
    """Compare the compiled labelling, where the set of touched taxels changes, with a plain one in every scan."""
    forces = {name: recorded(name, scans)[1] for name in (SCENES[1:2] if effort.short else SCENES)}
    wrong, labelled = dict.fromkeys(WAYS, 0), {COMPILED: 0, PLAIN: scans * len(forces)}
    for images in forces.values():
        compiled, plain = Compiled(), Plain()
        before: Regions = set()
        for force in images:
            wanted = plain.flooded(force)
            for name, way in ((COMPILED, compiled), (PLAIN, plain)):
                way(force)
                wrong[name] += way.regions() != wanted
            labelled[COMPILED] += wanted != before
            before = wanted
    calls = {
        f"{way}|{scene}": (lambda label=label, images=images: _through(label, images))
        for way, label in WAYS.items()
        for scene, images in forces.items()
    }
    seconds = interleaved(calls, effort.repeats)
    total = scans * len(forces)
    whole = {
        way: tuple(sum(seconds[f"{way}|{scene}"][k] for scene in forces) / total for k in range(effort.repeats))
        for way in WAYS
    }
    unit = float(np.median(whole[COMPILED]))
    choices = tuple(
        Choice(way, "", 100 * wrong[way] / total, whole[way], (
            100 * labelled[way] / total,
            *(float(np.median(seconds[f"{way}|{scene}"])) / scans / unit for scene in forces),
        )) for way in WAYS
    )  # fmt: skip
    own, other = choices
    return Front(
        "skipped_labelling",
        "Compiled and skipped work, labelling of contacts",
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
        f"Compiled, a scan takes {shown(own.median / other.median)} of the run time in Python; regions are labelled in "
        f"{shown(own.more[0])} % of the scans. No region differs: skipping costs a comparison of masks and no error.",
        why_not="Where nothing can be compiled, and every scan has few taxels.",
        question="the regions in contact",
        rival=other.name,
        swept=False,
        columns=("labelled %", *(f"run time, {scene}" for scene in forces)),
    )


def _through(label: Label, images: Sequence[Array]) -> None:
    way = label()
    for force in images:
        way(force)
