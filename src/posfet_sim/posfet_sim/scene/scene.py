# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Objects and temperature of a scene over time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from posfet_sim.contact.indenters import FLAT, Bend, Shape
from posfet_sim.scene.keyframes import Keyframes, Path, Pose, Span


class ObjectState(NamedTuple):
    """One object at one time."""

    x: float
    """Position along the columns, on the surface [m]."""
    y: float
    """Position along the rows, on the surface [m]."""
    angle: float
    """Rotation about the surface normal [rad]."""
    force: float
    """Normal force [N]; 0 without contact."""
    indentation: float
    """Indentation [m]; below 0: height above the surface."""


@dataclass(frozen=True)
class SceneObject:
    """One object of a scene."""

    name: str
    """Name, unique in the scene."""
    shape: Shape
    """Shape of its contact."""
    path: Path
    """Position, angle and load over time."""
    by_indentation: bool = False
    """Whether the load of the path is an indentation [m] instead of a force [N]."""
    temperature: float | None = None
    """Temperature [degC]; None: no heat transfer."""


@dataclass(frozen=True)
class ChipBend:
    """A chip bent to a cylinder, the array on its convex side."""

    radius: float
    """Radius of the cylinder [m]."""
    axis_x: bool
    """Whether the axis of the cylinder is along x, so that the columns are bent; else along y."""

    def along(self, angle: float) -> Bend:
        """Return the curvatures [1/m] along and across a direction at an angle [rad] from x."""
        bent, straight = (math.sin(angle) ** 2, math.cos(angle) ** 2)
        if not self.axis_x:
            bent, straight = straight, bent
        return (bent / self.radius, straight / self.radius)

    def surface_point(self, x: float, y: float) -> tuple[tuple[float, float, float], float]:
        """Return the point of the bent surface at the surface coordinates x, y.

        Parameters
        ----------
        x, y : float
            Coordinates along the surface [m]; the middle of the array is the origin.

        Returns
        -------
        tuple of (tuple of float, float)
            Position (x, y, z) [m], and the tilt of the normal from z towards the side of the point [rad].
        """
        along = y if self.axis_x else x
        tilt = along / self.radius
        out, down = self.radius * math.sin(tilt), self.radius * (math.cos(tilt) - 1)
        return ((x, out, down) if self.axis_x else (out, y, down)), tilt


@dataclass(frozen=True)
class TemperatureRise:
    """Temperature rise of the chip caused by the objects, piecewise linear in uniform steps."""

    step: float
    """Length of a step [s]."""
    values: tuple[float, ...]
    """Rise at the start of the scene and after each step [K]; constant after the last one."""

    def at(self, time: float) -> float:
        """Return the temperature rise [K] at a time [s] of the scene."""
        position = time / self.step
        index = int(position)
        if index >= len(self.values) - 1:
            return self.values[-1]
        return self.values[index] + (self.values[index + 1] - self.values[index]) * (position - index)

    def changes(self) -> list[Span]:
        """Return the intervals [s] in which it changes."""
        return [
            (index * self.step, (index + 1) * self.step)
            for index in range(len(self.values) - 1)
            if self.values[index] != self.values[index + 1]
        ]


@dataclass(frozen=True)
class Scene:
    """Objects and temperature over time; repeats after `period`."""

    name: str
    """Name of the scene."""
    description: str
    """One line on what happens."""
    period: float
    """Time after which the scene repeats [s]; infinite when it plays once."""
    objects: tuple[SceneObject, ...]
    """Objects that may touch the array."""
    temperature: Keyframes
    """Temperature of the chip without heat from objects [degC]."""
    bend: ChipBend | None = None
    """Bend of the chip; None: flat."""
    skin_thickness: float | None = None
    """Thickness of the elastomer skin [m]; None: the spread is that of the sensor file."""
    temperature_rise: TemperatureRise | None = None
    """Temperature rise caused by the objects; None: no heat transfer."""

    @property
    def duration(self) -> float:
        """Duration until the scene repeats, or until nothing changes any more [s]."""
        if math.isfinite(self.period):
            return self.period
        ends = self._changes[1]
        return ends[-1] if ends else 0.0

    def local_time(self, time: float) -> float:
        """Return the time within the period [s] for a time since the start [s]."""
        return math.fmod(time, self.period)

    def chip_temperature(self, time: float) -> float:
        """Return the chip temperature [degC] at a time [s] since the start."""
        local = self.local_time(time)
        (own,) = self.temperature.at(local)
        return own if self.temperature_rise is None else own + self.temperature_rise.at(local)

    def bend_along(self, item: SceneObject, angle: float) -> Bend:
        """Return the curvatures of the chip [1/m] along and across an object at an angle [rad].

        Parameters
        ----------
        item : SceneObject
            Object of the scene.
        angle : float
            Its angle about the surface normal [rad].
        """
        return FLAT if self.bend is None else self.bend.along(angle if item.shape.depends_on_angle else 0.0)

    def loaded_poses(self, item: SceneObject, times: Sequence[float]) -> list[Pose]:
        """Return position [m], angle [rad] and force [N] of an object at each time [s] since the start.

        Parameters
        ----------
        item : SceneObject
            Object of the scene.
        times : sequence of float
            Times since the start [s].
        """
        poses = [item.path.at(self.local_time(time)) for time in times]
        if not item.by_indentation:
            return poses
        shape = item.shape
        return [(x, y, angle, shape.force(load, self.bend_along(item, angle))) for x, y, angle, load in poses]

    def states(self, time: float) -> list[ObjectState]:
        """Return the state of each object at a time [s] since the start."""
        local = self.local_time(time)
        return [self._state(item, local) for item in self.objects]

    def _state(self, item: SceneObject, local: float) -> ObjectState:
        x, y, angle, load = item.path.at(local)
        bend = self.bend_along(item, angle)
        if item.by_indentation:
            return ObjectState(x, y, angle, item.shape.force(load, bend), load)
        return ObjectState(x, y, angle, load, item.shape.indentation(load, bend))

    def constant_until(self, time: float) -> float:
        """Return the time [s] up to which, from `time` [s] on, neither forces nor temperature change.

        It is `time` itself while one of them changes, and infinite when nothing changes any more. Motion without
        contact does not count.

        Parameters
        ----------
        time : float
            Time since the start [s].
        """
        local = self.local_time(time)
        starts, ends = self._changes
        index = bisect_right(ends, local)
        if index < len(ends):
            return time + max(starts[index] - local, 0.0)
        return time + (self.period - local) + starts[0] if starts and math.isfinite(self.period) else math.inf

    @cached_property
    def _changes(self) -> tuple[Sequence[float], Sequence[float]]:
        """Starts and ends of the disjoint intervals [s] of the scene in which a force or the temperature changes."""
        spans = self.temperature.changing(lambda a, b: a == b)
        for item in self.objects:
            spans += item.path.changes()
        if self.temperature_rise is not None:
            spans += self.temperature_rise.changes()
        starts: list[float] = []
        ends: list[float] = []
        for start, end in sorted(spans):
            if ends and start <= ends[-1]:
                ends[-1] = max(ends[-1], end)
            else:
                starts.append(start)
                ends.append(end)
        return starts, ends
