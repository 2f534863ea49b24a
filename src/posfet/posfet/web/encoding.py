# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""JSON of what the browser view shows: unknown numbers are null, arrays base64 of their bytes, NaN where unknown."""

from __future__ import annotations

import json
import math
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from posfet.colour_scale import hexadecimal
from posfet.snapshot import ContactView, Snapshot
from posfet.web.viewed import Viewed
from posfet_model.reconstruction.taxel_faults import TaxelStatus


def encoded_setup(sensors: Sequence[Viewed], scenes: Sequence[str]) -> bytes:
    """Return what changes rarely: the arrays, the colours and the scenes.

    Parameters
    ----------
    sensors : sequence of Viewed
        Sensors in the order of the page.
    scenes : sequence of str
        Names of the shipped scenes.
    """
    arrays = [None if each.client.array is None else asdict(each.client.array) for each in sensors]
    return _text(
        {
            "sensors": [
                {"namespace": each.client.namespace, "array": array}
                for each, array in zip(sensors, arrays, strict=True)
            ],
            "colours": hexadecimal(),
            "statuses": {each.value: each.name.lower() for each in TaxelStatus},
            "scenes": list(scenes),
        }
    )


def encoded_diagnoses(sensors: Sequence[Viewed]) -> bytes:
    """Return the diagnostics of each sensor, and the services that can be called.

    Parameters
    ----------
    sensors : sequence of Viewed
        Sensors in the order of the page.
    """
    return _text(
        [
            {
                "actions": each.actions(),
                "recording": each.recordings is not None and each.recordings.running,
                "nodes": [
                    {"name": found.name, "level": found.level, "text": found.text, "remedies": found.remedies}
                    for found in each.client.diagnoses.values()
                ],
            }
            for each in sensors
        ]
    )


def encoded_frame(sensors: Sequence[Viewed]) -> bytes:
    """Return the newest snapshot of each sensor; null before its first scan.

    Parameters
    ----------
    sensors : sequence of Viewed
        Sensors in the order of the page.
    """
    snapshots = [each.snapshots.snapshot() for each in sensors]
    return _text([None if found is None else _snapshot(found) for found in snapshots])


def _snapshot(snapshot: Snapshot) -> dict[str, Any]:
    unknown = np.full(snapshot.rows * snapshot.cols, np.nan, np.float32)
    deviation = unknown if snapshot.standard_deviation is None else snapshot.standard_deviation
    status = np.zeros(len(unknown)) if snapshot.status is None else snapshot.status
    return {
        "stamp": snapshot.stamp * 1e-6,  # [ms], as browsers count
        "sequence": snapshot.sequence,
        "scans": snapshot.scans,
        "frames_lost": snapshot.frames_lost,
        "scans_lost": snapshot.scans_lost,
        "valid": snapshot.data_valid,
        "force": _packed(snapshot.force, "<f4"),
        "deviation": _packed(deviation, "<f4"),
        "status": _packed(status, "u1"),
        "total": _known(snapshot.total_force),
        "total_deviation": _known(snapshot.total_standard_deviation),
        "contacts": [_contact(contact) for contact in snapshot.contacts],
        "truth": [asdict(true) for true in snapshot.truth],
        "state": snapshot.state,
        "calibration": snapshot.calibration,
    }


def _contact(contact: ContactView) -> dict[str, Any]:
    return {
        "id": contact.id,
        "state": contact.state,
        "x": _known(contact.x),
        "y": _known(contact.y),
        "force": _known(contact.force),
        "deviation": _known(contact.standard_deviation),
        "area": _known(contact.area),
        "age": contact.age,
        "major": [_known(value) for value in contact.major_axis],
        "minor": [_known(value) for value in contact.minor_axis],
        "velocity": [_known(value) for value in contact.velocity],
    }


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _packed(values: NDArray[Any], kind: str) -> str:
    return b64encode(values.astype(kind).tobytes()).decode()


def _text(value: Any) -> bytes:
    return json.dumps(_finite(value), separators=(",", ":"), allow_nan=False).encode()


def _finite(value: Any) -> Any:
    """Return a value with null for every number that JSON does not have, such as the radius of a flat chip."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return _known(value) if isinstance(value, float) else value
