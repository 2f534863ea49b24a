"""A scene bound to a sensor: which forces its objects put on the taxels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from posfet_model.sensor.description import Sensor
from posfet_sim.contact.indenters import Bend
from posfet_sim.contact.taxel_forces import FINEST_SPREAD, Cells, Footprint, spread_of_cover
from posfet_sim.loads import ObjectsState, Patch
from posfet_sim.scene.scene import ObjectState, Scene, SceneObject
from posfet_sim.scene.trajectories import Pose


class SceneLoads:
    """The loads of a scene on a sensor; see `Loads`. Each object meets only the taxels within its reach."""

    def __init__(self, scene: Scene, sensor: Sensor) -> None:
        """Take a scene that was read for this sensor."""
        self.scene = scene
        self._objects = [_Touching(scene, item, _cells(scene, item, sensor)) for item in scene.objects]
        self._steady = len(scene.temperature.times) == 1 and scene.warming is None

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    def forces(self, times: Sequence[float]) -> list[Patch]:
        """Return what presses on the array at these times; empty when nothing touches."""
        patches = []
        for item, touching in zip(self.scene.objects, self._objects, strict=True):
            patch = touching.patch(self.scene.presses(item, times))
            if patch is not None:
                patches.append(patch)
        return patches

    def temperatures(self, times: Sequence[float]) -> list[float]:
        """Return the chip's temperature [degC] at each of these times."""
        if self._steady:
            return [self.scene.chip_temperature(times[0])] * len(times)
        return [self.scene.chip_temperature(time) for time in times]

    def rests_until(self, time: float) -> float:
        """Return until when nothing changes [s]."""
        return self.scene.rests_until(time)

    def objects(self, time: float) -> ObjectsState:
        """Return the ground truth of the objects."""
        scene = self.scene
        states = scene.states(time)
        poses = [_pose(scene, item, state) for item, state in zip(scene.objects, states, strict=True)]
        touching = [index for index, state in enumerate(states) if state.force > 0]
        return ObjectsState(
            names=tuple(item.name for item in scene.objects),
            positions=np.reshape([pose[0] for pose in poses], (-1, 3)),
            orientations=np.reshape([pose[1] for pose in poses], (-1, 4)),
            contact_objects=np.array(touching, np.intp),
            contact_centres=np.reshape([(states[index].x, states[index].y) for index in touching], (-1, 2)),
            contact_normals=np.reshape([poses[index][2] for index in touching], (-1, 3)),
            contact_forces=np.array([states[index].force for index in touching], np.float64),
        )


class _Touching:
    """What one object does to the taxels; remembers the last, as an object that holds still does the same again."""

    def __init__(self, scene: Scene, item: SceneObject, cells: Cells) -> None:
        self._scene = scene
        self._item = item
        self._cells = cells
        self._held: tuple[Pose, Patch | None] | None = None
        self._last: tuple[float, Bend, list[Footprint]] | None = None

    def patch(self, presses: Sequence[Pose]) -> Patch | None:
        """Return its forces, one after the other; None when it touches no taxel."""
        first = presses[0]
        if any(press != first for press in presses):
            return self._press(presses)
        if first[3] <= 0:
            return None
        if self._held is None or self._held[0] != first:
            self._held = first, self._press([first])
        patch = self._held[1]
        if patch is None or len(presses) == 1:
            return patch
        return Patch(patch.rows, patch.cols, np.broadcast_to(patch.force, (len(presses), *patch.force.shape[1:])))

    def _press(self, presses: Sequence[Pose]) -> Patch | None:
        touching = [index for index, press in enumerate(presses) if press[3] > 0]
        if not touching:
            return None
        x, y, angle, force = np.array([presses[index] for index in touching]).T
        if not self._item.shape.turns:
            angle = np.zeros(len(touching))
        footprints = [self._footprints(*presses[index][2:]) for index in touching]
        patch = self._cells.press(footprints, x, y, angle, force)
        if patch is None:
            return None
        whole = patch.force
        if len(touching) < len(presses):
            whole = np.zeros((len(presses), *patch.force.shape[1:]))
            whole[touching] = patch.force
        whole.flags.writeable = False
        return Patch(patch.rows, patch.cols, whole)

    def _footprints(self, angle: float, force: float) -> list[Footprint]:
        bend = self._scene.bend_along(self._item, angle)
        if self._last is None or self._last[:2] != (force, bend):
            self._last = force, bend, self._item.shape.footprints(force, self._cells.spread, bend)
        return self._last[2]


def _cells(scene: Scene, item: SceneObject, sensor: Sensor) -> Cells:
    """Return the cells as an object meets them, with the least spread for its greatest force: one for all forces."""
    least, bend = spread(scene, sensor), scene.bend_along(item, 0.0)
    load = item.path.top_load()
    force = item.shape.force(load, bend) if item.by_indentation else load
    if force > 0:
        footprints = item.shape.footprints(force, least, bend)
        least = max(least, *[FINEST_SPREAD * max(part.half_length, part.half_width) for part in footprints])
    return Cells(sensor.layout, least)


def spread(scene: Scene, sensor: Sensor) -> float:
    """Return the standard deviation of the cover's spread [m]: the scene's, else the sensor's."""
    if scene.cover_thickness is None:
        return sensor.device.contact_spread
    return spread_of_cover(scene.cover_thickness)


def _pose(
    scene: Scene, item: SceneObject, state: ObjectState
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return position [m], orientation (x, y, z, w), and normal of the surface under the object."""
    height = item.shape.height - state.indentation
    half = state.angle / 2
    turn = (0.0, 0.0, math.sin(half), math.cos(half))
    if scene.bend is None:
        return (state.x, state.y, height), turn, (0.0, 0.0, 1.0)
    point, tilt = scene.bend.place(state.x, state.y)
    sin, cos = math.sin(tilt), math.cos(tilt)
    normal = (0.0, sin, cos) if scene.bend.axis_x else (sin, 0.0, cos)
    position = tuple(p + height * n for p, n in zip(point, normal, strict=True))
    # The tilt about x (by -tilt) or y, after the turn about z.
    s, c = math.sin(tilt / 2), math.cos(tilt / 2)
    orientation = (
        (-s * turn[3], s * turn[2], c * turn[2], c * turn[3])
        if scene.bend.axis_x
        else (s * turn[2], s * turn[3], c * turn[2], c * turn[3])
    )
    return position, orientation, normal
