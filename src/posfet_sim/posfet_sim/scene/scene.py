"""What a scene is made of."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from posfet_sim.contact.indenters import FLAT, Bend, Shape
from posfet_sim.scene.trajectories import Path, Pose, Span, Track


class ObjectState(NamedTuple):
    """One object at one time."""

    x: float
    """Along the surface [m]."""
    y: float
    angle: float
    """About the surface's normal [rad]."""
    force: float
    """[N]; 0 without touch."""
    indentation: float
    """How deep it is pressed in [m]; below 0: how high it is above the surface."""


@dataclass(frozen=True)
class SceneObject:
    """One object."""

    name: str
    shape: Shape
    path: Path
    by_indentation: bool = False
    """Whether the path's load is an indentation [m] instead of a force [N]."""
    temperature: float | None = None
    """[degC]; None: it conducts no heat."""


@dataclass(frozen=True)
class ChipBend:
    """A chip bent to a cylinder, the array on its outer side."""

    radius: float
    """[m]."""
    axis_x: bool
    """Whether the cylinder's axis lies along x, so that the columns are bent; else along y."""

    def along(self, angle: float) -> Bend:
        """Return the curvatures [1/m] along and across a direction at an angle [rad] from x."""
        bent, straight = (math.sin(angle) ** 2, math.cos(angle) ** 2)
        if not self.axis_x:
            bent, straight = straight, bent
        return (bent / self.radius, straight / self.radius)

    def place(self, x: float, y: float) -> tuple[tuple[float, float, float], float]:
        """Return the point of the surface [m] that lies x, y [m] along it, and the angle [rad] it is tilted by.

        The middle of the array stays at the origin. The tilt turns the normal from z towards the side of the point.
        """
        along = y if self.axis_x else x
        tilt = along / self.radius
        out, down = self.radius * math.sin(tilt), self.radius * (math.cos(tilt) - 1)
        return ((x, out, down) if self.axis_x else (out, y, down)), tilt


@dataclass(frozen=True)
class Warming:
    """By how much the objects warm the chip, in straight lines over even steps."""

    step: float
    """[s]."""
    values: tuple[float, ...]
    """At the start of the scene and after each step [K]; the last one holds."""

    def at(self, time: float) -> float:
        """Return the warming [K] at a time [s] of the scene."""
        place = time / self.step
        index = int(place)
        if index >= len(self.values) - 1:
            return self.values[-1]
        return self.values[index] + (self.values[index + 1] - self.values[index]) * (place - index)

    def changes(self) -> list[Span]:
        """Return the times [s] in which it changes."""
        return [
            (index * self.step, (index + 1) * self.step)
            for index in range(len(self.values) - 1)
            if self.values[index] != self.values[index + 1]
        ]


@dataclass(frozen=True)
class Scene:
    """Objects and temperature over time; after `period` it begins anew."""

    name: str
    description: str
    period: float
    """Time after which the scene repeats [s]; infinite when it plays once."""
    objects: tuple[SceneObject, ...]
    temperature: Track
    """Temperature of the chip [degC], but for what objects warm it by."""
    bend: ChipBend | None = None
    """None: the chip is flat."""
    cover_thickness: float | None = None
    """Thickness of the elastic cover [m]; None: its spread is the sensor file's."""
    warming: Warming | None = None
    """None: no object conducts heat."""

    @property
    def duration(self) -> float:
        """How long it plays until it repeats, or until nothing changes any more [s]."""
        if math.isfinite(self.period):
            return self.period
        ends = self._changes[1]
        return ends[-1] if ends else 0.0

    def local_time(self, time: float) -> float:
        """Return the time within the period [s] for a time since the start [s]."""
        return math.fmod(time, self.period)

    def chip_temperature(self, time: float) -> float:
        """Return the chip's temperature [degC] at a time [s] since the start."""
        local = self.local_time(time)
        (own,) = self.temperature.at(local)
        return own if self.warming is None else own + self.warming.at(local)

    def bend_along(self, item: SceneObject, angle: float) -> Bend:
        """Return the chip's curvatures [1/m] along and across an object at that angle [rad]."""
        return FLAT if self.bend is None else self.bend.along(angle if item.shape.turns else 0.0)

    def presses(self, item: SceneObject, times: Sequence[float]) -> list[Pose]:
        """Return place and force [N] of an object at each time [s] since the start."""
        poses = [item.path.at(self.local_time(time)) for time in times]
        if not item.by_indentation:
            return poses
        shape = item.shape
        return [(x, y, angle, shape.force(load, self.bend_along(item, angle))) for x, y, angle, load in poses]

    def states(self, time: float) -> list[ObjectState]:
        """Return each object at a time [s] since the start."""
        local = self.local_time(time)
        return [self._state(item, local) for item in self.objects]

    def _state(self, item: SceneObject, local: float) -> ObjectState:
        x, y, angle, load = item.path.at(local)
        bend = self.bend_along(item, angle)
        if item.by_indentation:
            return ObjectState(x, y, angle, item.shape.force(load, bend), load)
        return ObjectState(x, y, angle, load, item.shape.indentation(load, bend))

    def rests_until(self, time: float) -> float:
        """Return the time [s] up to which, from `time` on, no force and no temperature changes; `time` when one does.

        An object that moves without touching is at rest. Infinite when nothing will ever change again.
        """
        local = self.local_time(time)
        starts, ends = self._changes
        index = bisect_right(ends, local)
        if index < len(ends):
            return time + max(starts[index] - local, 0.0)
        return time + (self.period - local) + starts[0] if starts and math.isfinite(self.period) else math.inf

    @cached_property
    def _changes(self) -> tuple[Sequence[float], Sequence[float]]:
        """Starts and ends of the times of the scene [s] in which a force or the temperature changes, disjoint."""
        spans = self.temperature.changing(lambda a, b: a == b)
        for item in self.objects:
            spans += item.path.changes()
        if self.warming is not None:
            spans += self.warming.changes()
        starts: list[float] = []
        ends: list[float] = []
        for start, end in sorted(spans):
            if ends and start <= ends[-1]:
                ends[-1] = max(ends[-1], end)
            else:
                starts.append(start)
                ends.append(end)
        return starts, ends
