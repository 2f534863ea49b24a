"""A scene bound to a sensor: which forces its objects put on the taxels."""

from __future__ import annotations

import numpy as np

from posfet_driver.contact_pressure import SphereOnArray, hertz_sphere
from posfet_driver.loads import ObjectsState, Patch
from posfet_driver.scene import Scene
from posfet_model.sensor import Sensor


class SceneLoads:
    """The loads of a scene on a sensor; see `Loads`."""

    def __init__(self, scene: Scene, sensor: Sensor) -> None:
        self._scene = scene
        self._layout = sensor.layout
        self._spheres = [
            SphereOnArray(sensor.layout, sensor.device.contact_spread, item.radius, item.effective_modulus)
            for item in scene.objects
        ]

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._scene.name

    def forces(self, time: float) -> list[Patch]:
        """Return what presses on the array."""
        local = self._scene.local_time(time)
        forces = None
        for sphere, item in zip(self._spheres, self._scene.objects, strict=True):
            x, y, force = item.path.at(local)
            if force > 0:
                if forces is None:
                    forces = np.zeros((self._layout.rows, self._layout.cols))
                sphere.add(forces, x, y, force)
        return [] if forces is None else [Patch(slice(0, self._layout.rows), slice(0, self._layout.cols), forces)]

    def temperature(self, time: float) -> float:
        """Return the chip's temperature [degC]."""
        return self._scene.temperature.at(self._scene.local_time(time))[0]

    def rests_until(self, time: float) -> float:
        """Return until when nothing changes [s]."""
        return self._scene.rests_until(time)

    def objects(self, time: float) -> ObjectsState:
        """Return the ground truth of the objects."""
        local = self._scene.local_time(time)
        items = self._scene.objects
        poses = [item.path.at(local) for item in items]
        positions = [
            (x, y, item.radius - hertz_sphere(force, item.radius, item.effective_modulus).indentation)
            for item, (x, y, force) in zip(items, poses, strict=True)
        ]
        touching = [pose for pose in poses if pose[-1] > 0]
        return ObjectsState(
            names=tuple(item.name for item in items),
            positions=np.reshape(positions, (-1, 3)),
            orientations=np.tile([0.0, 0.0, 0.0, 1.0], (len(items), 1)),
            contact_centres=np.reshape([pose[:2] for pose in touching], (-1, 2)),
            contact_forces=np.array([pose[-1] for pose in touching], np.float64),
        )
