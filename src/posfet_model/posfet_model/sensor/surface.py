# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Geometry of the touched surface: flat, or bent to a cylinder with the array on its outer side.

Positions on the array are arc lengths along the surface. The frame of the array has its origin in the middle of the
array: x along columns, y along rows, z outward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout

Vector: TypeAlias = "tuple[float, float, float]"
FLAT_NORMAL: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Surface:
    """Points, normals and tangents of the surface in the frame of the array."""

    radius: float
    """Radius of the cylinder [m]; inf: flat."""
    axis_x: bool
    """Whether the cylinder's axis is parallel to x, so that the columns are bent; else to y."""

    @classmethod
    def of(cls, layout: Layout) -> Surface:
        """Return the surface of an array."""
        return cls(layout.bend_radius, layout.bend_axis == "x")

    @property
    def flat(self) -> bool:
        """Whether the surface is flat."""
        return math.isinf(self.radius)

    def tilt(self, x: float, y: float) -> float:
        """Return the angle [rad] between z and the normal at (x, y) [m], with the sign of the bent coordinate.

        Parameters
        ----------
        x : float
            Coordinate along the columns [m].
        y : float
            Coordinate along the rows [m].
        """
        return (y if self.axis_x else x) / self.radius

    def point(self, x: float, y: float) -> Vector:
        """Return the coordinates in space [m] of the point (x, y) [m] of the surface.

        Parameters
        ----------
        x : float
            Coordinate along the columns [m].
        y : float
            Coordinate along the rows [m].
        """
        if self.flat:
            return x, y, 0.0
        tilt = self.tilt(x, y)
        out, down = self.radius * math.sin(tilt), -2.0 * self.radius * math.sin(0.5 * tilt) ** 2
        return (x, out, down) if self.axis_x else (out, y, down)

    def normal(self, x: float, y: float) -> Vector:
        """Return the outward unit normal at (x, y) [m].

        Parameters
        ----------
        x : float
            Coordinate along the columns [m].
        y : float
            Coordinate along the rows [m].
        """
        tilt = self.tilt(x, y)
        sine, cosine = math.sin(tilt), math.cos(tilt)
        return (0.0, sine, cosine) if self.axis_x else (sine, 0.0, cosine)

    def along(self, x: float, y: float, vector: tuple[float, float]) -> Vector:
        """Return the components in space of a vector tangent to the surface at (x, y) [m].

        Parameters
        ----------
        x : float
            Coordinate along the columns [m].
        y : float
            Coordinate along the rows [m].
        vector : tuple of float
            Components along x and along y of the surface.
        """
        if self.flat:
            return (*vector, 0.0)
        tilt = self.tilt(x, y)
        sine, cosine = math.sin(tilt), math.cos(tilt)
        u, v = vector
        return (u, v * cosine, -v * sine) if self.axis_x else (u * cosine, v, -u * sine)

    def orientation(self, x: float, y: float) -> tuple[float, float, float, float]:
        """Return the unit quaternion (x, y, z, w) that rotates z to the normal at (x, y) [m].

        Parameters
        ----------
        x : float
            Coordinate along the columns [m].
        y : float
            Coordinate along the rows [m].
        """
        half = 0.5 * self.tilt(x, y)
        return (
            (-math.sin(half), 0.0, 0.0, math.cos(half)) if self.axis_x else (0.0, math.sin(half), 0.0, math.cos(half))
        )


def taxel_points(layout: Layout) -> NDArray[np.float64]:
    """Return the centres of the taxels in space [m], shape [rows * cols, 3]."""
    surface = Surface.of(layout)
    return np.array([surface.point(x, y) for x, y in layout.positions.tolist()])


def taxel_normals(layout: Layout) -> NDArray[np.float64]:
    """Return the outward unit normals of the taxels, shape [rows * cols, 3]."""
    surface = Surface.of(layout)
    return np.array([surface.normal(x, y) for x, y in layout.positions.tolist()])


@lru_cache(maxsize=8)
def wrench_per_newton(layout: Layout) -> NDArray[np.float64]:
    """Return force and torque about the origin of the frame of the array for a push of 1 N on each taxel.

    Parameters
    ----------
    layout : Layout
        Layout of the array.

    Returns
    -------
    ndarray of float64, shape [6, rows * cols]
        Force F (rows 0 to 2) [1] and torque ``r x F`` (rows 3 to 5) [m]; read-only.
    """
    normals = taxel_normals(layout)
    wrench: NDArray[np.float64] = np.hstack([-normals, -np.cross(taxel_points(layout), normals)]).T.copy()
    wrench.setflags(write=False)
    return wrench
