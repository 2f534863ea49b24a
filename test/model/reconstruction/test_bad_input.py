# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every input fault, at rest and during a held touch: flagged, recovered within 50 ms, and without lasting effect."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from reference.dense_pressure import sphere_forces
from support.long_cases import crossed, long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
FINGER = sphere_forces(0.6e-3, -0.4e-3, 1.0, 6e-3, 1e6, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)
BEGIN = 1000
"""Index of the scan in which a fault begins; the scan period is 1 ms."""
RECOVERED = 50

Edit = Callable[[int, Scan], "bool | None"]


def set_field(length: int, **fields: Any) -> Edit:
    def edit(index: int, scan: Scan) -> None:
        if BEGIN <= index < BEGIN + length:
            for name, value in fields.items():
                setattr(scan, name, value)

    return edit


def fill(length: int, count: int) -> Edit:
    def edit(index: int, scan: Scan) -> None:
        if BEGIN <= index < BEGIN + length:
            scan.counts[:] = count

    return edit


def random_counts(length: int) -> Edit:
    def edit(index: int, scan: Scan) -> None:
        if BEGIN <= index < BEGIN + length:
            ends = np.random.default_rng(index).random(LAYOUT.taxels) < 0.5
            scan.counts[:] = np.where(ends, 0, 0xFFFF)

    return edit


def drop(length: int) -> Edit:
    return lambda index, scan: not BEGIN <= index < BEGIN + length


def later(field: str, change: int) -> Edit:
    """Return a fault that shifts a clock permanently."""

    def edit(index: int, scan: Scan) -> None:
        if index >= BEGIN:
            setattr(scan, field, getattr(scan, field) + change)

    return edit


def restarts(index: int, scan: Scan) -> None:
    if index >= BEGIN:
        scan.sequence, scan.device_time = index - BEGIN, 1000 * (index - BEGIN)
        scan.status = int(ScanStatus.BOARD_RESET) if index == BEGIN else scan.status


FAULTS: dict[str, tuple[int, Edit]] = {
    "no temperature": (0, set_field(300, temperatures=np.full(2, np.nan, np.float32))),
    "one lost": (0, drop(1)),
    "20 lost": (0, drop(20)),
    "200 lost": (0, drop(200)),
    "ADC fault": (5, set_field(5, status=int(ScanStatus.ADC_FAULT))),
    "other layout": (5, set_field(5, layout_id=99)),
    "too few counts": (5, set_field(5, counts=np.zeros(3, np.uint16))),
    "no counts": (5, set_field(5, counts=np.zeros(0, np.uint16))),
    "all zero": (5, fill(5, 0)),
    "full scale": (5, fill(5, 0xFFFF)),
    "random ends": (5, random_counts(5)),
    "clock ahead": (1, later("device_time", 10**9)),
    "clock behind": (1, later("device_time", -500_000)),
    "sequence far ahead": (0, later("sequence", 2**31)),
    "begins anew": (1, restarts),
}
"""By name: minimum number of flagged scans, and the fault."""


def play(force: float, edit: Edit, repeat: bool = False) -> tuple[list[tuple[int, bool, Any, Any]], Reconstructor]:
    """Return (index, valid, forces, standard deviations) of every scan from `BEGIN` on that gave a frame."""
    reconstructor = Reconstructor(SENSOR)
    frames = []
    for time, original in scans(SENSOR, 1.6, force=press(force, 0.5, 9.0), shape=FINGER):
        index, scan = round(time * 1000), original.snapshot()
        if edit(index, scan) is False:
            continue
        for _ in range(2 if repeat and index >= BEGIN else 1):
            result = reconstructor.process(scan)
            if index >= BEGIN and (result.accepted or result.unusable):
                image = reconstructor.image()
                frames.append((index, result.valid, image.force.copy(), image.standard_deviation.copy()))
    return frames, reconstructor


@lru_cache
def undisturbed(force: float) -> dict[int, Any]:
    """Return the forces of every scan without a fault, by index."""
    return {index: forces for index, _, forces, _ in play(force, lambda index, scan: None)[0]}


@pytest.mark.parametrize(
    ("name", "force"),
    long_cases(
        crossed(FAULTS.keys(), [0.0, 1.5]),
        [*(f"{name}-1.5" for name in FAULTS), *(f"{name}-0.0" for name in ("200 lost", "random ends", "clock behind"))],
    ),
)
def test_a_fault_is_flagged_and_has_no_effect_after_50_ms(name: str, force: float) -> None:
    flagged, edit = FAULTS[name]
    frames, _ = play(force, edit)
    quiet = undisturbed(force)
    assert sum(not valid for index, valid, *_ in frames if index >= BEGIN) >= flagged
    end = BEGIN + {"20 lost": 20, "200 lost": 200}.get(name, 5)
    after = [frame for frame in frames if frame[0] >= end + RECOVERED]
    assert len(after) > 300
    assert all(valid for _, valid, *_ in after)
    # The leakage estimate is less accurate or different; the reported uncertainty covers its error.
    for index, _, forces, deviations in after:
        assert (np.abs(forces - quiet[index]) <= np.maximum(5e-3, deviations)).all()


@pytest.mark.parametrize("force", [0.0, 1.5])
def test_duplicate_scans_change_nothing(force: float) -> None:
    twice, reconstructor = play(force, lambda index, scan: None, repeat=True)
    once, _ = play(force, lambda index, scan: None)
    assert reconstructor.counts.repeated == 600
    assert [index for index, *_ in twice] == [index for index, *_ in once]
    np.testing.assert_array_equal(twice[-1][2], once[-1][2])


def test_a_force_held_through_an_interruption_is_invalid_until_release() -> None:
    reconstructor = Reconstructor(SENSOR)
    valid = {}
    for time, scan in scans(SENSOR, 5.0, force=press(1.5, 0.5, 3.0), shape=FINGER):
        index = round(time * 1000)
        if not 700 <= index < 1500:
            valid[index] = reconstructor.process(scan).valid
    assert valid[699]
    assert not any(ok for index, ok in valid.items() if 1500 <= index < 3000)
    assert valid[4999]
    assert math.isclose(reconstructor.image().total, 0.0, abs_tol=0.02)


def test_a_temperature_sensor_that_fails_leaves_the_force_as_it_was() -> None:
    """Both sensors report the same, 10 times a second while the chip warms: each of them alone suffices."""

    def total(failing: bool) -> list[tuple[bool, float]]:
        reconstructor, totals = Reconstructor(SENSOR), []
        for time, scan in scans(
            SENSOR, 2.5, press(1.0, 1.5, 9.0), FINGER, lambda time: 25.0 + 0.5 * max(time - 0.5, 0)
        ):
            # A reading of 1/256 K, as the sensors have.
            scan.temperatures[:] = round((25.0 + 0.5 * max(math.floor(time * 10) / 10 - 0.5, 0)) * 256) / 256
            if failing and time >= 0.8:
                scan.temperatures[1] = math.nan
            result = reconstructor.process(scan)
            totals.append((result.valid, reconstructor.image().total))
        return totals

    sound = total(failing=False)
    assert sound[-1] == (True, pytest.approx(1.0, abs=0.1))
    np.testing.assert_array_equal(total(failing=True), sound)


def outside(reconstructor: Reconstructor, result: Reconstruction) -> dict[str, Any]:
    """Return what is seen from outside, apart from whether the last scan was accepted, and its cause."""
    image, counts = reconstructor.image().snapshot(), asdict(reconstructor.counts)
    seen = asdict(image) | {"vibration": reconstructor.vibration(), "result": asdict(result.snapshot())}
    for name in ("accepted", "unusable"):
        del seen["result"][name]
    for name in ("late", "repeated"):
        del counts[name]
    return seen | {"counts": counts, "faulty": reconstructor.faulty, "due": reconstructor.maintenance_due}


@pytest.mark.parametrize("back", [0, 3])
@pytest.mark.parametrize("unusable_before", [False, True])
def test_a_refused_duplicate_or_late_scan_changes_nothing_seen_from_outside(back: int, unusable_before: bool) -> None:
    """After every scan of two blocks of 20 ms under a touch: after some of them a block is due."""
    reconstructor = Reconstructor(SENSOR)
    reconstructor.vibration_wanted = True
    contents = itertools.cycle(itertools.product((0, 0xFFFF, 0x9000), (0, int(ScanStatus.ADC_FAULT))))
    for time, scan in scans(SENSOR, 0.7, press(1.5, 0.5, 9.0), FINGER):
        result = reconstructor.process(scan)
        if time < 0.66:
            continue
        if unusable_before:
            fault = copy.deepcopy(scan)
            fault.sequence, fault.status = scan.sequence + 1, int(ScanStatus.ADC_FAULT)
            result = reconstructor.process(fault)
            assert result.unusable
        before = outside(reconstructor, result)
        refused, (count, status) = copy.deepcopy(scan), next(contents)
        refused.sequence, refused.stamp = scan.sequence - back, scan.stamp - 1_000_000 * back
        refused.counts[:], refused.status = count, status
        result = reconstructor.process(refused)
        assert not result.accepted
        assert not result.unusable
        np.testing.assert_equal(outside(reconstructor, result), before)
    assert (reconstructor.counts.late if back else reconstructor.counts.repeated) == 40
