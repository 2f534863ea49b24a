# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans and their ground truth as serialised ROS messages, each written into one buffer that is prepared once."""

from __future__ import annotations

import math
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.scan import TEMPERATURE_SENSORS, Scan
from posfet_sim.loads import ObjectsState
from posfet_sim.recording.cdr import PreparedMessage

FRAME_ID: Final = "posfet_array"
"""Frame of the messages."""
RAW: Final = "posfet_msgs/TactileRaw"
"""Type of the scans."""
TRUTH: Final = "posfet_msgs/TactileTruth"
"""Type of the ground truth."""

_HEADER: Final = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": FRAME_ID}


class TrueState(Protocol):
    """What is recorded of a ground truth, as in `Truth`."""

    @property
    def force(self) -> NDArray[np.float64]:
        """Force on each taxel [N], shape [rows * cols]."""
        ...

    @property
    def taxel_status(self) -> NDArray[np.uint8]:
        """Fault of each taxel, shape [rows * cols]."""
        ...

    @property
    def chip_temperature(self) -> float:
        """Temperature of the chip [degC]."""
        ...

    @property
    def film_temperature(self) -> float:
        """Temperature of the film [degC]."""
        ...

    @property
    def objects(self) -> ObjectsState:
        """Poses and contacts of the objects."""
        ...


class ScanMessage:
    """TactileRaw of the scans of one array.

    Parameters
    ----------
    rows : int
        Rows of the array.
    cols : int
        Columns of the array.
    """

    def __init__(self, rows: int, cols: int) -> None:
        taxels = rows * cols
        prepared = PreparedMessage(
            RAW,
            {
                "header": _HEADER,
                "layout_id": 0,
                "sequence": 0,
                "device_time": 0,
                "rows": rows,
                "cols": cols,
                "counts": np.zeros(taxels),
                "temperatures": np.zeros(TEMPERATURE_SENSORS),
                "status": 0,
                "frames_lost": 0,
                "stamp_uncertainty": math.nan,
            },
        )
        self._data = prepared.data
        self._stamp = prepared.numbers("header.stamp", "<i4", 2)
        self._layout_id = prepared.numbers("layout_id", "<u4", 1)
        self._clock = prepared.numbers("device_time", "<u8", 2)
        self._counts = prepared.numbers("counts", "<u2", taxels)
        self._temperatures = prepared.numbers("temperatures", "<f4", TEMPERATURE_SENSORS)
        self._status = prepared.numbers("status", "<u4", 1)
        self._lost = prepared.numbers("frames_lost", "<u8", 1)
        self._uncertainty = prepared.numbers("stamp_uncertainty", "<f4", 1)

    def fill(self, scan: Scan) -> bytes:
        """Return the serialised message of a scan.

        Parameters
        ----------
        scan : Scan
            The scan.
        """
        self._stamp[:] = divmod(scan.stamp, NANOSECONDS)
        self._layout_id[0] = scan.layout_id
        self._clock[0] = scan.sequence
        self._clock[1] = scan.device_time
        self._counts[:] = scan.counts
        self._temperatures[:] = scan.temperatures
        self._status[0] = scan.status
        self._lost[0] = scan.frames_lost
        self._uncertainty[0] = scan.stamp_uncertainty
        return self._data()


class TruthMessage:
    """TactileTruth of the scans of one array; prepared again when other objects, or another number of them, touch.

    Parameters
    ----------
    rows : int
        Rows of the array.
    cols : int
        Columns of the array.
    """

    def __init__(self, rows: int, cols: int) -> None:
        self._shape = rows, cols
        self._lengths: tuple[tuple[str, ...], int] | None = None

    def fill(self, truth: TrueState, scan: Scan) -> bytes:
        """Return the serialised message of a ground truth.

        Parameters
        ----------
        truth : TrueState
            Ground truth of the scan.
        scan : Scan
            The scan.
        """
        objects = truth.objects
        lengths = tuple(objects.names), len(objects.contact_objects)
        if lengths != self._lengths:
            self._prepare(*lengths)
        self._stamp[:] = divmod(scan.stamp, NANOSECONDS)
        self._layout_id[0] = scan.layout_id
        self._sequence[0] = scan.sequence
        self._force[:] = truth.force
        self._status[:] = truth.taxel_status
        self._temperatures[0] = truth.film_temperature
        self._temperatures[1] = truth.chip_temperature
        self._poses[:, :3] = objects.positions
        self._poses[:, 3:] = objects.orientations
        if lengths[1]:
            self._contact_objects[:] = objects.contact_objects
            self._centres[:, :2] = objects.contact_centres
            self._normals[:] = objects.contact_normals
            self._forces[:] = objects.contact_forces
        return self._data()

    def _prepare(self, names: tuple[str, ...], contacts: int) -> None:
        self._lengths = names, contacts
        rows, cols = self._shape
        taxels = rows * cols
        vector = {"x": 0.0, "y": 0.0, "z": 0.0}
        values: dict[str, Any] = {
            "header": _HEADER,
            "layout_id": 0,
            "sequence": 0,
            "rows": rows,
            "cols": cols,
            "force": np.zeros(taxels),
            "status": np.zeros(taxels),
            "temperature": 0.0,
            "chip_temperature": 0.0,
            "objects": names,
            "poses": [{"position": vector, "orientation": {**vector, "w": 0.0}}] * len(names),
            "contact_objects": np.zeros(contacts),
            "contact_centres": [vector] * contacts,
            "contact_normals": [vector] * contacts,
            "contact_forces": np.zeros(contacts),
        }
        prepared = PreparedMessage(TRUTH, values)
        self._data = prepared.data
        self._stamp = prepared.numbers("header.stamp", "<i4", 2)
        self._layout_id = prepared.numbers("layout_id", "<u4", 1)
        self._sequence = prepared.numbers("sequence", "<u8", 1)
        self._force = prepared.numbers("force", "<f4", taxels)
        self._status = prepared.numbers("status", "|u1", taxels)
        self._temperatures = prepared.numbers("chip_temperature", "<f4", 2)
        self._poses = prepared.numbers("poses", "<f8", 7 * len(names)).reshape(-1, 7)
        self._contact_objects = prepared.numbers("contact_objects", "<u2", contacts)
        self._centres = prepared.numbers("contact_centres", "<f8", 3 * contacts).reshape(-1, 3)
        self._normals = prepared.numbers("contact_normals", "<f8", 3 * contacts).reshape(-1, 3)
        self._forces = prepared.numbers("contact_forces", "<f4", contacts)
