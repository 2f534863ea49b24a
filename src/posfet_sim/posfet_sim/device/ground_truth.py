# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Ground truth of a simulated board at the time of one scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout
from posfet_sim.loads import Loads, ObjectsState

_OBJECT_COLUMNS: Final = (
    *("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"),
    *("force_N", "contact_x_m", "contact_y_m", "normal_x", "normal_y", "normal_z"),
)


@dataclass(frozen=True, eq=False)
class Truth:
    """True forces, temperatures, taxel faults and objects at the time of one scan."""

    sequence: int
    """Sequence of the scan."""
    time: float
    """Sampling time [s] since the board started."""
    force: NDArray[np.float64]
    """Force on each taxel [N], shape [rows * cols], positive when pushed into the sensor."""
    chip_temperature: float
    """Temperature of the chip [degC]."""
    film_temperature: float
    """Temperature of the film [degC]."""
    taxel_status: NDArray[np.uint8]
    """Fault of each taxel, TAXEL_* of posfet_msgs/TactileImage, shape [rows * cols]."""
    loads: Loads
    """What acts on the sensor."""

    @cached_property
    def objects(self) -> ObjectsState:
        """Poses and contacts of the objects; computed when first asked for."""
        return self.loads.objects(self.time)


def truth_columns(layout: Layout, names: Sequence[str]) -> list[str]:
    """Return the column names of `truth_row`, each with its unit.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    names : sequence of str
        Names of the objects.
    """
    columns = ["sequence", "time_s", "chip_temperature_degC", "film_temperature_degC"]
    for name in names:
        columns += [f"{name}.{column}" for column in _OBJECT_COLUMNS]
    taxels = [(row, col) for row in range(layout.rows) for col in range(layout.cols)]
    columns += [f"force_{row}_{col}_N" for row, col in taxels]
    return columns + [f"status_{row}_{col}" for row, col in taxels]


def truth_row(truth: Truth) -> list[int | float]:
    """Return a ground truth as one row of numbers, in the order of `truth_columns`.

    An object without contact has force 0, and NaN for the centre and the normal of its contact.

    Parameters
    ----------
    truth : Truth
        Ground truth of the scan.
    """
    objects = truth.objects
    contacts = np.full((len(objects.names), 6), math.nan)
    contacts[:, 0] = 0.0
    touching = objects.contact_objects
    contacts[touching, 0] = objects.contact_forces
    contacts[touching, 1:3] = objects.contact_centres
    contacts[touching, 3:] = objects.contact_normals
    described = np.hstack([objects.positions, objects.orientations, contacts])
    return [
        truth.sequence,
        truth.time,
        truth.chip_temperature,
        truth.film_temperature,
        *described.ravel().tolist(),
        *truth.force.tolist(),
        *truth.taxel_status.tolist(),
    ]
