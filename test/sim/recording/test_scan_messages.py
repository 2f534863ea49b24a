# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans and ground truths in prepared buffers are the bytes of the general serialisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from posfet_model.sensor.scan import Scan
from posfet_sim.loads import ObjectsState
from posfet_sim.recording.cdr import PreparedMessage, serialise
from posfet_sim.recording.scan_messages import FRAME_ID, RAW, TRUTH, ScanMessage, TruthMessage

SHAPES = [(1, 1), (5, 5), (3, 7), (16, 16)]


@dataclass
class State:
    """A ground truth."""

    force: np.ndarray
    taxel_status: np.ndarray
    chip_temperature: float
    film_temperature: float
    objects: ObjectsState


def header(scan: Scan) -> dict[str, Any]:
    seconds, nanoseconds = divmod(scan.stamp, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": FRAME_ID}


def vector(names: str, values: Any) -> dict[str, float]:
    return dict(zip(names, values, strict=True))


def raw_bytes(scan: Scan, rows: int, cols: int) -> bytes:
    """Return TactileRaw of a scan, field by field."""
    return serialise(
        RAW,
        {
            "header": header(scan),
            "layout_id": scan.layout_id,
            "sequence": scan.sequence,
            "device_time": scan.device_time,
            "rows": rows,
            "cols": cols,
            "counts": scan.counts,
            "temperatures": scan.temperatures,
            "status": int(scan.status),
            "frames_lost": scan.frames_lost,
            "stamp_uncertainty": scan.stamp_uncertainty,
        },
    )


def truth_bytes(state: State, scan: Scan, rows: int, cols: int) -> bytes:
    """Return TactileTruth of a ground truth, field by field."""
    objects = state.objects
    return serialise(
        TRUTH,
        {
            "header": header(scan),
            "layout_id": scan.layout_id,
            "sequence": scan.sequence,
            "rows": rows,
            "cols": cols,
            "force": state.force,
            "status": state.taxel_status,
            "temperature": state.film_temperature,
            "chip_temperature": state.chip_temperature,
            "objects": objects.names,
            "poses": [
                {"position": vector("xyz", position), "orientation": vector("xyzw", orientation)}
                for position, orientation in zip(objects.positions, objects.orientations, strict=True)
            ],
            "contact_objects": objects.contact_objects,
            "contact_centres": [vector("xyz", (*centre, 0.0)) for centre in objects.contact_centres],
            "contact_normals": [vector("xyz", normal) for normal in objects.contact_normals],
            "contact_forces": objects.contact_forces,
        },
    )


def scans(rows: int, cols: int, count: int = 20) -> list[Scan]:
    """Return scans with extreme and random values."""
    random = np.random.default_rng(rows * cols)
    first = Scan.empty(0xFFFF_FFFF, rows * cols)
    last = Scan(2**31 * 10**9 - 1, 1, 2**64 - 1, 2**64 - 1, np.full(rows * cols, 65535, np.uint16),
                np.array([-40.0, 150.0], np.float32), 2**32 - 1, 2**64 - 1, 0.0)  # fmt: skip
    between = [
        Scan(
            int(random.integers(2**60)), int(random.integers(2**32)), int(random.integers(2**62)),
            int(random.integers(2**62)), random.integers(65536, size=rows * cols).astype(np.uint16),
            random.normal(25.0, 10.0, 2).astype(np.float32), int(random.integers(256)), int(random.integers(2**40)),
            float(random.random()),
        )
        for _ in range(count)
    ]  # fmt: skip
    return [first, *between, last]


@pytest.mark.parametrize(("rows", "cols"), SHAPES)
def test_scans_are_the_bytes_of_their_fields(rows: int, cols: int) -> None:
    message = ScanMessage(rows, cols)
    for scan in scans(rows, cols):
        assert message.fill(scan) == raw_bytes(scan, rows, cols)


@pytest.mark.parametrize(("rows", "cols"), SHAPES)
def test_truths_are_the_bytes_of_their_fields_whatever_touches(rows: int, cols: int) -> None:
    random, message = np.random.default_rng(7), TruthMessage(rows, cols)
    names: tuple[str, ...]
    for number, scan in enumerate(scans(rows, cols, 40)):
        names = ((), ("ball",), ("a", "longer name"), ("a", "other name1", "x"))[number // 3 % 4]
        touching = np.sort(random.permutation(len(names))[: random.integers(len(names) + 1)])
        objects = ObjectsState(
            names, random.normal(size=(len(names), 3)), random.normal(size=(len(names), 4)), touching,
            random.normal(size=(len(touching), 2)), random.normal(size=(len(touching), 3)),
            random.normal(size=len(touching)),
        )  # fmt: skip
        state = State(
            random.normal(size=rows * cols),
            random.integers(5, size=rows * cols).astype(np.uint8),
            *random.normal(25, 5, 2),
            objects,
        )
        assert message.fill(state, scan) == truth_bytes(state, scan, rows, cols)


def test_a_message_that_was_returned_does_not_change() -> None:
    message, (first, second, *_) = ScanMessage(5, 5), scans(5, 5)
    data = message.fill(first)
    message.fill(second)
    assert data == raw_bytes(first, 5, 5)


def test_a_prepared_message_has_the_fields_of_its_type() -> None:
    with pytest.raises(ValueError, match="must have the fields sec, nanosec, got sec"):
        PreparedMessage("builtin_interfaces/Time", {"sec": 1})


def test_a_number_out_of_the_range_of_its_field_is_refused() -> None:
    scan = Scan.empty(1, 25)
    scan.sequence = -1
    with pytest.raises(OverflowError):
        ScanMessage(5, 5).fill(scan)
