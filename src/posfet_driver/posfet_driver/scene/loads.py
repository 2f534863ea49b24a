"""A scene bound to a sensor: which forces its objects put on the taxels."""

from __future__ import annotations

import math

import numpy as np

from posfet_driver.contact_pressure_cells import Cells, Footprint, spread_of_cover
from posfet_driver.loads import ObjectsState, Patch
from posfet_driver.scene.model import ObjectState, Scene, SceneObject
from posfet_driver.scene.shapes import Bend
from posfet_model.sensor import Sensor


class SceneLoads:
    """The loads of a scene on a sensor; see `Loads`. Each object meets only the taxels within its reach."""

    def __init__(self, scene: Scene, sensor: Sensor) -> None:
        """Take a scene that was read for this sensor."""
        self.scene = scene
        self._cells = Cells(sensor.layout, spread(scene, sensor))
        self._last: list[tuple[ObjectState, Patch | None] | None] = [None] * len(scene.objects)
        self._footprints: list[tuple[float, Bend, list[Footprint]] | None] = [None] * len(scene.objects)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    def forces(self, time: float) -> list[Patch]:
        """Return what presses on the array; empty when nothing touches."""
        patches = []
        for index, (item, state) in enumerate(zip(self.scene.objects, self.scene.states(time), strict=True)):
            if state.force > 0:
                last = self._last[index]
                if last is None or last[0] != state:
                    last = self._last[index] = (state, self._press(index, item, state))
                if last[1] is not None:
                    patches.append(last[1])
        return patches

    def _press(self, index: int, item: SceneObject, state: ObjectState) -> Patch | None:
        bend = self.scene.bend_along(item, state.angle)
        last = self._footprints[index]
        if last is None or last[:2] != (state.force, bend):
            footprints = item.shape.footprints(state.force, self._cells.spread, bend)
            last = self._footprints[index] = (state.force, bend, footprints)
        angle = state.angle if item.shape.turns else 0.0
        patch = self._cells.press(last[2], state.x, state.y, angle, state.force)
        if patch is not None:
            patch.force.flags.writeable = False
        return patch

    def temperature(self, time: float) -> float:
        """Return the chip's temperature [degC]."""
        return self.scene.chip_temperature(time)

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
