# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Loads of a scene on a sensor: forces of its objects on the taxels, and chip temperature."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from posfet_model.sensor.description import Sensor
from posfet_sim.contact.indenters import Bend
from posfet_sim.contact.taxel_forces import MIN_RELATIVE_SPREAD, Cells, Footprint, skin_spread
from posfet_sim.loads import ObjectsState, Patch
from posfet_sim.scene.keyframes import Pose
from posfet_sim.scene.scene import ObjectState, Scene, SceneObject


class SceneLoads:
    """Loads of a scene on a sensor; see `Loads`. Each object affects only the taxels within its reach.

    Parameters
    ----------
    scene : Scene
        Scene that was loaded for this sensor.
    sensor : Sensor
        Sensor description.
    """

    def __init__(self, scene: Scene, sensor: Sensor) -> None:
        self.scene = scene
        """The scene."""
        self._objects = [_ObjectLoads(scene, item, _cells(scene, item, sensor)) for item in scene.objects]
        self._steady = len(scene.temperature.times) == 1 and scene.temperature_rise is None

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    @property
    def live(self) -> bool:
        """False: a scene is known in advance."""
        return False

    def forces(self, times: Sequence[float]) -> list[Patch]:
        """Return the forces on the array at these times [s]; empty without contact."""
        patches = []
        for item, loads in zip(self.scene.objects, self._objects, strict=True):
            patch = loads.patch(self.scene.loaded_poses(item, times))
            if patch is not None:
                patches.append(patch)
        return patches

    def temperatures(self, times: Sequence[float]) -> list[float]:
        """Return the chip temperature [degC] at each of these times [s]."""
        if self._steady:
            return [self.scene.chip_temperature(times[0])] * len(times)
        return [self.scene.chip_temperature(time) for time in times]

    def constant_until(self, time: float) -> float:
        """Return the time [s] up to which, from `time` [s] on, nothing changes."""
        return self.scene.constant_until(time)

    def objects(self, time: float) -> ObjectsState:
        """Return the ground truth of the objects at a time [s]."""
        scene = self.scene
        states = scene.states(time)
        poses = [_pose(scene, item, state) for item, state in zip(scene.objects, states, strict=True)]
        touching = [index for index, state in enumerate(states) if state.force > 0]
        return ObjectsState(
            names=tuple(item.name for item in scene.objects),
            positions=np.array([pose[0] for pose in poses], np.float64).reshape(-1, 3),
            orientations=np.array([pose[1] for pose in poses], np.float64).reshape(-1, 4),
            contact_objects=np.array(touching, np.intp),
            contact_centres=np.array([(states[index].x, states[index].y) for index in touching], np.float64).reshape(
                -1, 2
            ),
            contact_normals=np.array([poses[index][2] for index in touching], np.float64).reshape(-1, 3),
            contact_forces=np.array([states[index].force for index in touching], np.float64),
        )


class _ObjectLoads:
    """Forces of one object on the taxels; the last result is cached for an object that does not move."""

    def __init__(self, scene: Scene, item: SceneObject, cells: Cells) -> None:
        self._scene = scene
        self._item = item
        self._cells = cells
        self._held: tuple[Pose, Patch | None] | None = None
        self._last: tuple[float, Bend, list[Footprint]] | None = None

    def patch(self, poses: Sequence[Pose]) -> Patch | None:
        """Return the forces at consecutive times; None without contact."""
        first = poses[0]
        if any(pose != first for pose in poses):
            return self._press(poses)
        if first[3] <= 0:
            return None
        if self._held is None or self._held[0] != first:
            self._held = first, self._press([first])
        patch = self._held[1]
        if patch is None or len(poses) == 1:
            return patch
        return Patch(patch.rows, patch.cols, np.broadcast_to(patch.force, (len(poses), *patch.force.shape[1:])))

    def _press(self, poses: Sequence[Pose]) -> Patch | None:
        touching = [index for index, pose in enumerate(poses) if pose[3] > 0]
        if not touching:
            return None
        x, y, angle, force = np.array([poses[index] for index in touching]).T
        if not self._item.shape.depends_on_angle:
            angle = np.zeros(len(touching))
        footprints = [self._footprints(*poses[index][2:]) for index in touching]
        patch = self._cells.press(footprints, x, y, angle, force)
        if patch is None:
            return None
        whole = patch.force
        if len(touching) < len(poses):
            whole = np.zeros((len(poses), *patch.force.shape[1:]))
            whole[touching] = patch.force
        whole.flags.writeable = False
        return Patch(patch.rows, patch.cols, whole)

    def _footprints(self, angle: float, force: float) -> list[Footprint]:
        bend = self._scene.bend_along(self._item, angle)
        if self._last is None or self._last[:2] != (force, bend):
            self._last = force, bend, self._item.shape.footprints(force, self._cells.spread, bend)
        return self._last[2]


def _cells(scene: Scene, item: SceneObject, sensor: Sensor) -> Cells:
    """Return the cells for an object, with the minimum spread for its maximum force, so that it is always the same."""
    minimum, bend = spread(scene, sensor), scene.bend_along(item, 0.0)
    load = item.path.max_load()
    force = item.shape.force(load, bend) if item.by_indentation else load
    if force > 0:
        footprints = item.shape.footprints(force, minimum, bend)
        minimum = max(minimum, *[MIN_RELATIVE_SPREAD * max(part.half_length, part.half_width) for part in footprints])
    return Cells(sensor.layout, minimum)


def spread(scene: Scene, sensor: Sensor) -> float:
    """Return the standard deviation of the spread by the elastomer skin [m]: that of the scene, else of the sensor.

    Parameters
    ----------
    scene : Scene
        Scene, whose thickness of the skin takes precedence.
    sensor : Sensor
        Sensor description.
    """
    if scene.skin_thickness is None:
        return sensor.device.contact_spread
    return skin_spread(scene.skin_thickness)


def _pose(
    scene: Scene, item: SceneObject, state: ObjectState
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return position [m] and orientation (x, y, z, w) of the object, and the surface normal under it."""
    height = item.shape.height - state.indentation
    half = state.angle / 2
    rotation = (0.0, 0.0, math.sin(half), math.cos(half))
    if scene.bend is None:
        return (state.x, state.y, height), rotation, (0.0, 0.0, 1.0)
    point, tilt = scene.bend.surface_point(state.x, state.y)
    sin, cos = math.sin(tilt), math.cos(tilt)
    normal = (0.0, sin, cos) if scene.bend.axis_x else (sin, 0.0, cos)
    position = tuple(p + height * n for p, n in zip(point, normal, strict=True))
    # The tilt about x (by -tilt) or y, after the rotation about z.
    s, c = math.sin(tilt / 2), math.cos(tilt / 2)
    orientation = (
        (-s * rotation[3], s * rotation[2], c * rotation[2], c * rotation[3])
        if scene.bend.axis_x
        else (s * rotation[2], s * rotation[3], c * rotation[2], c * rotation[3])
    )
    return position, orientation, normal
