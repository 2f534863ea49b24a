"""Work that is not done, counted for each shipped scene, and what that saves."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.simulation import NONE, SENSOR, SHIPPED, run
from posfet_driver.scene import load_scene
from posfet_driver.simulated_board import SimulatedBoard
from posfet_model.conversions import ForceImageMessage, ImageMessage, PointsMessage, WrenchMessage
from posfet_model.model_node import MARKER_PERIOD
from posfet_model.reconstruction import Reconstructor
from posfet_model.scan import Scan

SCANS = 2500


def labelled(scene: str) -> tuple[int, float, float]:
    """Return in how many scans regions were labelled, and the mean times of a scan without and with that [us]."""
    board, reconstructor = SimulatedBoard(SENSOR, load_scene(scene, SENSOR), 0), Reconstructor(SENSOR)
    bitmap = reconstructor._finder._bitmap
    label, count = bitmap.regions, 0

    def counting(bits: int) -> list[int]:
        nonlocal count
        count += 1
        return label(bits)

    bitmap.regions = counting
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    taken: dict[bool, list[int]] = {False: [], True: []}
    for index in range(SCANS):
        board.scan(index, scan)
        before, begin = count, time.perf_counter_ns()
        reconstructor.process(scan)
        taken[count > before].append(time.perf_counter_ns() - begin)
    without, with_labels = (float(np.median(part)) * 1e-3 if part else float("nan") for part in taken.values())
    return count, without, with_labels


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
    updates = saved = 0.0
    for name in SHIPPED:
        scene = load_scene(name, SENSOR)
        lazy, whole = (SimulatedBoard(SENSOR, scene, 0, NONE.without_noise(), full=full) for full in (False, True))
        cheap, dear = (run(board, range(SCANS)) / SCANS * 1e6 for board in (lazy, whole))
        share = 1 - lazy.taxel_updates / whole.taxel_updates
        labels, without, with_labels = labelled(name)
        skipped = SCANS - labels
        gain = skipped / SCANS * (with_labels - without) if labels and skipped else 0.0
        rows.append((name, f"{100 * share:.0f} %", dear - cheap, f"{skipped} of {SCANS}", gain, avoided, unfilled))
        updates += share / len(SHIPPED)
        saved += (dear - cheap) / len(SHIPPED)
    columns = ("scene", "taxel updates avoided", "saved us a scan", "labellings avoided", "saved us a scan",
               "messages avoided", "saved us a scan")  # fmt: skip
    note = (
        f"{SCANS} scans each, 5 x 5. Messages: image, wrench, force_image, points and markers, which nobody asked for; "
        f"of markers {shown} would be sent, as they are for eyes. Saved: only filling them. Labellings: with measuring "
        "and following the contacts."
    )
    values = {"skipped_taxel_updates_pct": 100 * updates, "skipped_taxel_updates_saved_us": saved,
              "skipped_messages_saved_us": unfilled}  # fmt: skip
    return Outcome(values, [Table("Work avoided", columns, rows, note)])
