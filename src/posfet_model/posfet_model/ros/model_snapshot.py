# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Copies of the newest reconstruction, for a display in the same process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.tracker import Contact
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.sensor.description import Layout


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Copy of the newest reconstruction, for a display."""

    stamp: int
    """Acquisition time [ns] since the Unix epoch."""
    sequence: int
    valid: bool
    force: NDArray[np.float32]
    """[N], shape [rows, cols]; NaN: unknown."""
    standard_deviation: NDArray[np.float32]
    """Standard uncertainty of each force [N], shape [rows, cols]; NaN: unknown."""
    status: NDArray[np.uint8]
    """Values of TaxelStatus, shape [rows, cols]."""
    total: float
    """Total force [N]; NaN: unknown."""
    total_standard_deviation: float
    """Standard uncertainty of the total force [N]; NaN: unknown."""
    contacts: tuple[Contact, ...]
    scans: int
    """Scans accepted since the start."""
    missed: int
    """Scans that were never received."""
    calibration: str
    """Date of the calibration, or what its absence costs, in one line."""


def snapshot(reconstructor: Reconstructor, result: Reconstruction, layout: Layout) -> Snapshot:
    """Return a copy of a result and of the force image of its scan.

    Parameters
    ----------
    reconstructor : Reconstructor
        Source of the image.
    result : Reconstruction
        Its newest result.
    layout : Layout
        Layout of the array.
    """
    image, counts = reconstructor.image(), reconstructor.counts
    shape = layout.rows, layout.cols
    return Snapshot(
        stamp=result.stamp,
        sequence=result.sequence,
        valid=result.valid,
        force=image.force.reshape(shape).copy(),
        standard_deviation=image.standard_deviation.reshape(shape).copy(),
        status=image.status.reshape(shape).copy(),
        total=image.total,
        total_standard_deviation=image.total_standard_deviation,
        contacts=result.contacts,
        scans=counts.accepted,
        missed=counts.missed,
        calibration=reconstructor.calibration.summary,
    )
