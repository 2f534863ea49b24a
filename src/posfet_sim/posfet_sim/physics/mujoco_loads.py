# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts of a fingertip in MuJoCo as loads of the simulated board. Loads `mujoco` when an object is made."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.validation import real_number
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_sim.contact.indenters import Sphere
from posfet_sim.physics.engine_loads import EngineContact, EngineLoads
from posfet_sim.physics.face_pressure import FacePressure, Pressure

EFFECTIVE_MODULUS: Final = 2e6
"""Effective modulus of object and elastomer skin together [Pa]; assumed, for objects without one of their own."""
MIN_HALF_WIDTH: Final = 0.1e-3
"""Half-width of a contact that has no extent in the engine [m]; assumed."""
MIN_ALIGNMENT: Final = 0.5
"""Cosine of the greatest angle between the contact normal and the normal of the array: other faces of the fingertip
bear what is beyond."""


class _Point(NamedTuple):
    """A contact point of the engine in the frame of the array."""

    position: Array
    """x and y [m]."""
    force: Array
    """Force on the sensor, x, y and z [N]."""
    sliding: Array
    """Velocity of the object's surface against that of the fingertip, x and y [m/s]."""


class MujocoLoads(EngineLoads):
    """Loads of one fingertip in a MuJoCo model.

    `read` takes the contacts of the fingertip's geoms from the engine and pushes them as a state. All points of one
    object are one contact: under a sphere, the Hertz pressure about the point; under anything else, a `FacePressure` on
    the rectangle that the points span along the axes of the object. Total normal force and centre of pressure are those
    of the engine. Ellipsoids count as spheres of their smallest semi-axis; capsules and cylinders are at least as wide
    as a Hertz line contact.

    Parameters
    ----------
    sensor : Sensor
        Sensor description; a bent chip is not supported.
    model, data : mujoco.MjModel, mujoco.MjData
        The model and its state, which the caller steps.
    site : str
        Site whose frame is that of the array: in the middle of its surface, z along the outward normal.
    geoms : sequence of str
        Names of the geoms of the fingertip.
    effective_moduli : mapping of str to float, optional
        Effective modulus [Pa] of an object and the skin together, by the name of its geom.
    advance : callable, optional
        Called with a time [s] for which there is no state yet; it steps the engine and calls `read`.

    Raises
    ------
    ConfigError
        The package `mujoco` is missing.
    KeyError
        The model has no such site or geom.
    ValueError
        The chip is bent, or a modulus is out of range.
    """

    def __init__(
        self,
        sensor: Sensor,
        model: Any,
        data: Any,
        site: str,
        geoms: Sequence[str],
        effective_moduli: Mapping[str, float] | None = None,
        advance: Callable[[float], None] | None = None,
    ) -> None:
        super().__init__(sensor, advance, name=f"MuJoCo, fingertip {site}")
        try:
            import mujoco  # noqa: PLC0415  # the package is optional
        except ImportError as error:
            raise ConfigError("contacts of MuJoCo need the package mujoco: pip install mujoco") from error
        self._mujoco = mujoco
        self._model, self._data = model, data
        self._site = model.site(site).id
        self._own = {model.geom(name).id for name in geoms}
        self._moduli = {
            model.geom(name).id: real_number("effective modulus", value, 1e3, 1e12)
            for name, value in (effective_moduli or {}).items()
        }
        self.origin = float(data.time)
        """Time of the engine at which that of the loads begins [s]; may be changed until the first `read`."""
        self._wrench = np.zeros(6)
        self._velocity = np.zeros(6)

    def read(self) -> None:
        """Push the contacts of the engine at its present time, counted from `origin`."""
        points = self._points()
        self.push(self._data.time - self.origin, [self._contact(geom, found) for geom, found in points.items()])

    def _points(self) -> dict[int, list[_Point]]:
        """Return the contact points on the face of the array, by the geom that touches there."""
        data = self._data
        axes = data.site_xmat[self._site].reshape(3, 3)
        origin = data.site_xpos[self._site]
        found: dict[int, list[_Point]] = {}
        for number in range(data.ncon):
            contact = data.contact[number]
            first, second = int(contact.geom1), int(contact.geom2)
            if (first in self._own) == (second in self._own):
                continue
            frame = contact.frame.reshape(3, 3)
            if abs(float(frame[0] @ axes[:, 2])) < MIN_ALIGNMENT:
                continue
            self._mujoco.mj_contactForce(self._model, data, number, self._wrench)
            on_second = frame.T @ self._wrench[:3]
            force = axes.T @ (on_second if second in self._own else -on_second)
            own, other = (second, first) if second in self._own else (first, second)
            sliding = axes.T @ (self._velocity_at(other, contact.pos) - self._velocity_at(own, contact.pos))
            position = axes.T @ (contact.pos - origin)
            found.setdefault(other, []).append(_Point(position[:2], force, sliding[:2]))
        return found

    def _velocity_at(self, geom: int, position: Array) -> Array:
        """Return the velocity of a geom's material at a position, in the frame of the world [m/s]."""
        kind = self._mujoco.mjtObj.mjOBJ_GEOM
        self._mujoco.mj_objectVelocity(self._model, self._data, kind, geom, self._velocity, 0)
        turning, moving = self._velocity[:3], self._velocity[3:]
        lever = position - self._data.geom_xpos[geom]
        return np.array(
            [
                moving[0] + turning[1] * lever[2] - turning[2] * lever[1],
                moving[1] + turning[2] * lever[0] - turning[0] * lever[2],
                moving[2] + turning[0] * lever[1] - turning[1] * lever[0],
            ]
        )

    def _contact(self, geom: int, points: list[_Point]) -> EngineContact:
        """Return the points of one object as one contact."""
        positions = np.array([point.position for point in points])
        normal = np.array([max(-float(point.force[2]), 0.0) for point in points])
        force = math.fsum(normal)
        share = normal / force if force > 0 else np.full(len(points), 1 / len(points))
        centre = share @ positions
        angle, pressure, middle = self._pressure(geom, positions, centre, force)
        tangential = np.sum([point.force[:2] for point in points], axis=0)
        sliding = share @ np.array([point.sliding for point in points])
        return EngineContact(
            object=self._model.geom(geom).name or f"geom {geom}",
            position=(float(middle[0]), float(middle[1])),
            force=force,
            pressure=pressure,
            angle=angle,
            tangential_force=(float(tangential[0]), float(tangential[1])),
            sliding=(float(sliding[0]), float(sliding[1])),
        )

    def _pressure(self, geom: int, positions: Array, centre: Array, force: float) -> tuple[float, Pressure, Array]:
        """Return angle [rad], pressure and reference point [m] of a contact at these positions with this centre."""
        types, size = self._mujoco.mjtGeom, self._model.geom_size[geom]
        kind = self._model.geom_type[geom]
        modulus = self._moduli.get(geom, EFFECTIVE_MODULUS)
        if kind in {types.mjGEOM_SPHERE, types.mjGEOM_ELLIPSOID}:
            radius = float(size[0] if kind == types.mjGEOM_SPHERE else size.min())
            return 0.0, Sphere(radius, modulus), centre
        angle = self._angle(geom)
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        along = positions @ turn.T
        low, high = along.min(axis=0), along.max(axis=0)
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, MIN_HALF_WIDTH)
        if kind in {types.mjGEOM_CAPSULE, types.mjGEOM_CYLINDER}:
            # Hertz: a^2 = 4*F*R/(pi*L*E) (Johnson, Contact Mechanics, 1985, equation 4.43)
            width = math.sqrt(4 * force * float(size[0]) / (math.pi * 2 * float(half.max()) * modulus))
            half = np.maximum(half, min(width, float(size[0])))
        offset = turn @ centre - middle
        pressure = FacePressure(float(half[0]), float(half[1]), (float(offset[0]), float(offset[1])))
        return angle, pressure, turn.T @ middle

    def _angle(self, geom: int) -> float:
        """Return the angle, about the normal, of the geom's axis that is most parallel to the surface [rad]."""
        axes = self._data.site_xmat[self._site].reshape(3, 3).T @ self._data.geom_xmat[geom].reshape(3, 3)
        flattest = int(np.abs(axes[2]).argmin())
        return math.atan2(float(axes[1, flattest]), float(axes[0, flattest]))
