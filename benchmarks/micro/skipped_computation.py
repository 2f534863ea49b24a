"""Work that is not done, counted for each shipped scene, and what that saves."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.simulation.runs import NONE, SENSOR, SHIPPED, run
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.conversions import ForceImageMessage, ImageMessage, PointsMessage, WrenchMessage
from posfet_model.ros.model_node import MARKER_PERIOD
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
    bitmap = reconstructor._finder._bitmap
    label, count = bitmap.components, 0

    def counting(bits: int) -> list[int]:
        nonlocal count
        count += 1
        return label(bits)

    bitmap.components = counting
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    taken: dict[bool, list[int]] = {False: [], True: []}
    for index in range(SCANS):
        board.scan(index, scan)
        begin = time.perf_counter_ns()
        result = reconstructor.process(scan)
        taken[bool(result.contacts)].append(time.perf_counter_ns() - begin)
    idle, touched = (float(np.median(part)) * 1e-3 if part else float("nan") for part in taken.values())
    return count, len(taken[False]), idle, touched


def message_cost() -> float:
    """Return what filling the messages of one scan that nobody asked for would cost, without sending them [us]."""
    reconstructor = Reconstructor(SENSOR)
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    scan.counts[:] = 32768
    result = reconstructor.process(scan)
    layout = SENSOR.layout
    messages = [made(layout, "frame") for made in (ImageMessage, WrenchMessage, ForceImageMessage, PointsMessage)]
    begin = time.perf_counter_ns()
    for _ in range(500):
        image = reconstructor.image()
        for message in messages:
            message.fill(result, image)
    return (time.perf_counter_ns() - begin) / 500 * 1e-3


def measure(full: bool) -> Outcome:
    """Count and time each scene, a listener on `contacts` alone."""
    del full
    rows: list[tuple[Cell, ...]] = []
    unfilled = message_cost()
    seconds = SCANS / SENSOR.can.scan_rate
    shown = round(seconds * 1e9 / MARKER_PERIOD)
    avoided = 4 * SCANS + SCANS
    updates = saved = labellings = 0.0
    for name in SHIPPED:
        scene = load_scene(name, SENSOR)
        lazy, whole = (
            SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0, NONE.without_noise(), compute_all=full)
            for full in (False, True)
        )
        cheap, dear = (run(board, range(SCANS)) / SCANS * 1e6 for board in (lazy, whole))
        share = 1 - lazy.taxel_updates / whole.taxel_updates
        labels, quiet, idle, touched = labelled(name)
        gain = quiet / SCANS * (touched - idle) if labels and quiet else 0.0
        skipped = f"{100 * share:.0f} %", dear - cheap, f"{SCANS - labels} of {SCANS}", quiet, gain
        rows.append((name, *skipped, avoided, unfilled))
        labellings += (1 - labels / SCANS) / len(SHIPPED)
        updates += share / len(SHIPPED)
        saved += (dear - cheap) / len(SHIPPED)
    columns = (
        "scene", "taxel updates avoided", "saved us a scan", "labellings avoided", "scans without a contact",
        "saved us a scan", "messages avoided", "saved us a scan",
    )  # fmt: skip
    note = (
        f"{SCANS} scans each, 5 x 5. Regions are labelled when a scan touches other taxels than the last one. Where "
        "nothing touches, measuring and following end early: that is what the scans without a contact save. Messages: "
        "image, wrench, force_image, points and markers, which nobody asked for; of the markers "
        f"{shown} would be sent, as they are for eyes. Saved there: only filling them."
    )
    values = {
        "skipped_labellings_pct": 100 * labellings,
        "skipped_taxel_updates_pct": 100 * updates,
        "skipped_taxel_updates_saved_us": saved,
        "skipped_messages_saved_us": unfilled,
    }
    return Outcome(values, [Table("Work avoided", columns, rows, note)])
