# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Skipped computation in each shipped scene, and the time it saves."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.simulation.runs import NONE, SENSOR, SHIPPED, run
from posfet_model.parameters import DISPLAY_RATE
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.map_messages import ForceImageMessage, ImageMessage, PointsMessage
from posfet_model.ros.wrench_messages import WrenchMessage
from posfet_model.sensor.scan import Scan
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

SCANS = 2500


def labelled(scene: str) -> tuple[int, int, float, float]:
    """Return the number of scans with labelled regions and without touch, and median times.

    The median times [us] are those of a scan without touch and of one with a contact.
    """
    board, reconstructor = (
        SimulatedBoard(SENSOR, SceneLoads(load_scene(scene, SENSOR), SENSOR), 0),
        Reconstructor(SENSOR),
    )
    count, regions = 0, list[list[int]]()
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    times: dict[bool, list[int]] = {False: [], True: []}
    for index in range(SCANS):
        board.scan(index, scan)
        begin = time.perf_counter_ns()
        result = reconstructor.process(scan)
        times[bool(result.contacts)].append(time.perf_counter_ns() - begin)
        before, regions = regions, [region.tolist() for region in reconstructor._finder.regions]
        count += regions != before
    idle, touched = (float(np.median(part)) * 1e-3 if part else float("nan") for part in times.values())
    return count, len(times[False]), idle, touched


def message_cost() -> float:
    """Return the time to fill the messages of one scan that have no subscriber, without publishing them [us]."""
    reconstructor = Reconstructor(SENSOR)
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    scan.counts[:] = 32768
    result = reconstructor.process(scan)
    layout = SENSOR.layout
    messages = [
        message_type(layout, "frame")
        for message_type in (ImageMessage, WrenchMessage, ForceImageMessage, PointsMessage)
    ]
    begin = time.perf_counter_ns()
    for _ in range(500):
        image = reconstructor.image()
        for message in messages:
            message.fill(result, image)
    return (time.perf_counter_ns() - begin) / 500 * 1e-3


def measure(full: bool) -> Outcome:
    """Count and time each scene, with a subscriber to `contacts` only."""
    del full
    rows: list[tuple[Cell, ...]] = []
    unfilled = message_cost()
    seconds = SCANS / SENSOR.can.scan_rate
    shown = round(seconds * DISPLAY_RATE.default)
    skipped_messages = 4 * SCANS + SCANS
    updates = saved = labellings = 0.0
    for name in SHIPPED:
        scene = load_scene(name, SENSOR)
        lazy, whole = (
            SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0, NONE.without_noise(), compute_all=full)
            for full in (False, True)
        )
        lazy_time, full_time = (run(board, range(SCANS)) / SCANS * 1e6 for board in (lazy, whole))
        share = 1 - lazy.taxel_updates / whole.taxel_updates
        labels, quiet, idle, touched = labelled(name)
        gain = quiet / SCANS * (touched - idle) if labels and quiet else 0.0
        skipped = f"{100 * share:.0f} %", full_time - lazy_time, f"{SCANS - labels} of {SCANS}", quiet, gain
        rows.append((name, *skipped, skipped_messages, unfilled))
        labellings += (1 - labels / SCANS) / len(SHIPPED)
        updates += share / len(SHIPPED)
        saved += (full_time - lazy_time) / len(SHIPPED)
    columns = (
        "scene", "taxel updates skipped", "saved us per scan", "labellings skipped", "scans without contact",
        "saved us per scan", "messages skipped", "saved us per scan",
    )  # fmt: skip
    note = (
        f"{SCANS} scans each, 5 x 5. Regions are labelled when the touched taxels differ from those of the last scan. "
        "Without contact, measuring and tracking exit early, which is the time saved by these scans. Messages: "
        "image, wrench, force_image, points and markers, which have no subscriber; of the markers only "
        f"{shown} would be published, at the rate of the display. The time saved is that of filling them."
    )
    values = {
        "skipped_labellings_pct": 100 * labellings,
        "skipped_taxel_updates_pct": 100 * updates,
        "skipped_taxel_updates_saved_us": saved,
        "skipped_messages_saved_us": unfilled,
    }
    return Outcome(values, [Table("Skipped computation", columns, rows, note)])
