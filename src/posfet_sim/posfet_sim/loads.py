# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interface between the loads on a sensor (such as those of a scene) and the simulated board.

The board knows no objects. It asks for the forces on the taxels at the sampling times, for the chip temperature, and
until when both are constant, so that it can skip computation. Times are in seconds since the board started; periodic
loads repeat behind this interface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Patch:
    """Forces on a rectangle of taxels at several times; overlapping patches add up."""

    rows: slice
    """Rows of the rectangle."""
    cols: slice
    """Columns of the rectangle."""
    force: NDArray[np.float64]
    """Force on each taxel of the rectangle [N], shape [times, rows, cols], positive when pushed into the sensor."""


@dataclass(frozen=True, eq=False)
class ObjectsState:
    """Poses and contacts of the objects at one time."""

    names: tuple[str, ...]
    """Name of each object."""
    positions: NDArray[np.float64]
    """Position of the reference point of each object [m], shape [objects, 3], in the frame of the array."""
    orientations: NDArray[np.float64]
    """Orientation of each object as a quaternion (x, y, z, w), shape [objects, 4]."""
    contact_objects: NDArray[np.intp]
    """Indices of the objects in contact, shape [contacts]."""
    contact_centres: NDArray[np.float64]
    """Centre of pressure of each object in contact [m], shape [contacts, 2], x and y along the surface; may lie outside
    the array."""
    contact_normals: NDArray[np.float64]
    """Outward normal of the surface there, shape [contacts, 3]."""
    contact_forces: NDArray[np.float64]
    """Normal force of each object in contact [N], shape [contacts]."""


class Loads(Protocol):
    """Forces on the taxels and temperature of the chip over time."""

    @property
    def name(self) -> str:
        """Name of the loads, such as that of the scene."""
        ...

    @property
    def live(self) -> bool:
        """Whether the loads depend on what is done until then, as those of a physics engine that a controller acts on.

        The board then asks for no time before the scan of that time is read.
        """
        ...

    def forces(self, times: Sequence[float]) -> Sequence[Patch]:
        """Return the forces on the array at several times.

        Parameters
        ----------
        times : sequence of float
            Times since the start [s], ascending.

        Returns
        -------
        sequence of Patch
            Empty when nothing touches at any of the times. The same time gives the same forces, to rounding, whatever
            the other times are. The arrays are never written to again: the caller may keep them.
        """
        ...

    def temperatures(self, times: Sequence[float]) -> Sequence[float]:
        """Return the chip temperature [degC] at each of these times [s]."""
        ...

    def constant_until(self, time: float) -> float:
        """Return the time [s] up to which, from `time` [s] on, neither forces nor temperature change.

        It is `time` itself while one of them changes, and infinite when nothing changes any more.

        Parameters
        ----------
        time : float
            Time since the start [s].
        """
        ...

    def objects(self, time: float) -> ObjectsState:
        """Return the ground truth of the objects at a time [s]."""
        ...
