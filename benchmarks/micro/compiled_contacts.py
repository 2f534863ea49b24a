# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled path of contacts beside the plain reference in Python: processor time for the same scans."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.outcome import Cell, Outcome, Table
from posfet_model.contacts.detection import ContactFinder, ForceEstimate
from posfet_model.contacts.slip import DynamicChannel
from posfet_model.contacts.tracker import ContactTracker
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import force_noise_rms
from reference.contacts import detection, slip, tracker

SIZES = (5, 16, 32, 64)
STEP = 1e-3
FINGERS = 2

Forces = NDArray[np.float64]


def forces_of(sensor: Sensor, scans: int) -> list[Forces]:
    """Return the forces of fingertips that move about the array, scan by scan [N]."""
    random, layout = np.random.default_rng(1), sensor.layout
    reach = 0.3 * np.array([layout.cols * layout.pitch_x, layout.rows * layout.pitch_y])
    begin, speed = random.uniform(-reach, reach, (FINGERS, 2)), random.normal(0.0, 5e-6, (FINGERS, 2))
    found = []
    for scan in range(scans):
        square = ((layout.positions - (begin + scan * speed)[:, None]) ** 2).sum(axis=2)
        noise = random.normal(0.0, force_noise_rms(sensor), layout.taxels)
        found.append(np.exp(-0.5 * square / 1.5e-3**2).sum(axis=0) + noise)
    return found


def compiled(sensor: Sensor) -> Callable[[Forces, Forces], None]:
    """Return the function that follows the contacts of a scan by the compiled path."""
    finder, following = ContactFinder(sensor), ContactTracker(sensor)
    channel = DynamicChannel(sensor.layout, force_noise_rms(sensor))
    force, variance = np.zeros(sensor.layout.taxels), np.full(sensor.layout.taxels, force_noise_rms(sensor) ** 2)
    estimate = ForceEstimate(force, variance)

    def follow(now: Forces, change: Forces) -> None:
        force[:] = now
        finder.find(force)
        channel.advance(change, STEP)
        following.follow(finder, estimate, STEP)
        channel.update(following, force, STEP)

    return follow


def plain(sensor: Sensor) -> Callable[[Forces, Forces], None]:
    """Return the function that follows the contacts of a scan by the reference."""
    finder, following = detection.ContactFinder(sensor), tracker.ContactTracker(sensor)
    channel = slip.DynamicChannel(sensor.layout, force_noise_rms(sensor))
    force, variance = np.zeros(sensor.layout.taxels), np.full(sensor.layout.taxels, force_noise_rms(sensor) ** 2)
    estimate = detection.ForceEstimate(force, variance)

    def follow(now: Forces, change: Forces) -> None:
        force[:] = now
        regions = finder.find(force)
        channel.advance(change, STEP)
        contacts = following.update(finder.measure(regions, estimate, following.regions), STEP)
        channel.update(contacts, force, STEP)

    return follow


def microseconds(follow: Callable[[Forces, Forces], None], forces: list[Forces]) -> float:
    """Return the median processor time of a scan [us]."""
    times, before = [], forces[0]
    for force in forces:
        change = force - before
        begin = time.thread_time_ns()
        follow(force, change)
        times.append(time.thread_time_ns() - begin)
        before = force
    return float(np.median(times)) * 1e-3


def measure(full: bool) -> Outcome:
    """Time both on the same forces, for several sizes of the array."""
    rows: list[tuple[Cell, ...]] = []
    values = {}
    for size in SIZES:
        sensor = load_sensor()
        sensor = replace(sensor, layout=replace(sensor.layout, rows=size, cols=size))
        forces = forces_of(sensor, 1000 if full else 200)
        own, reference = (microseconds(way(sensor), forces) for way in (compiled, plain))
        rows.append((f"{size} x {size}", own, reference, reference / own))
        values[f"contacts_{size}x{size}_us"] = own
        values[f"contacts_{size}x{size}_reference_over_compiled"] = reference / own
    note = (
        f"{FINGERS} fingertips that move. Detection, moments, tracking and slip, with the objects of the results; "
        "median processor time of a scan. The reference is the former code of this stack in NumPy, without its caches; "
        "test/model/contacts/test_compiled_contacts.py holds both to 1e-12."
    )
    columns = ("array", "compiled us", "reference us", "reference over compiled")
    return Outcome(values, [Table("Contacts, compiled", columns, rows, note)])
