"""What a scene does to one sensor: the seam between scenes (objects, paths, contact pressure) and the simulated board.

The board knows no objects. It asks for the forces on the taxels at the time of a scan, for the chip's temperature, and
until when nothing will change, so that it can leave out what is not needed. Times are seconds since the board started;
what repeats, repeats behind this interface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Patch:
    """Forces on a rectangle of taxels at some times; patches may overlap, and then add up."""

    rows: slice
    cols: slice
    force: NDArray[np.float64]
    """Force on each taxel of the rectangle [N], shape [times, rows, cols], positive when pushed into the sensor."""


@dataclass(frozen=True)
class ObjectsState:
    """Where the objects are and what they do at one time."""

    names: tuple[str, ...]
    positions: NDArray[np.float64]
    """Centre of each object [m], shape [objects, 3], in the frame of the array."""
    orientations: NDArray[np.float64]
    """Orientation of each object as a quaternion (x, y, z, w), shape [objects, 4]."""
    contact_objects: NDArray[np.intp]
    """Which of the objects touch, shape [touching]."""
    contact_centres: NDArray[np.float64]
    """Centre of pressure of each object that touches [m], shape [touching, 2], x and y along the surface, whether it
    falls on a taxel or not."""
    contact_normals: NDArray[np.float64]
    """Outward normal of the surface there, shape [touching, 3]."""
    contact_forces: NDArray[np.float64]
    """Normal force of each object that touches [N], shape [touching]."""


class Loads(Protocol):
    """A scene bound to a sensor."""

    @property
    def name(self) -> str:
        """Name of the scene."""
        ...

    def forces(self, times: Sequence[float]) -> Sequence[Patch]:
        """Return what presses on the array at these times; empty when nothing touches at any of them.

        The same time gives the same forces, to rounding, whatever else is asked for. The arrays may be kept: they are
        never written to again.
        """
        ...

    def temperatures(self, times: Sequence[float]) -> Sequence[float]:
        """Return the chip's temperature [degC] at each of these times."""
        ...

    def rests_until(self, time: float) -> float:
        """Return the time up to which, from `time` on, neither forces nor temperature change.

        `time` when one does; infinite when nothing will ever change again.
        """
        ...

    def objects(self, time: float) -> ObjectsState:
        """Return the ground truth of the objects."""
        ...
