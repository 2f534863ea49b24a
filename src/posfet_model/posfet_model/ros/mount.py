# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Pose of the array on the robot, in a parent frame, with the convention of the `origin` of URDF."""

from __future__ import annotations

import math
from dataclasses import dataclass

from posfet_model.config import ConfigError


@dataclass(frozen=True)
class Mount:
    """Pose of the frame of the array in a parent frame."""

    position: tuple[float, float, float]
    """x, y, z [m]."""
    orientation: tuple[float, float, float, float]
    """Unit quaternion x, y, z, w."""


def parse_mount(text: str) -> Mount:
    """Return the pose given as text.

    Parameters
    ----------
    text : str
        "x y z roll pitch yaw" [m, rad]. The angles are rotations about the fixed x, y and z axes of the parent frame,
        in this order (`rpy` of URDF, REP 103).

    Raises
    ------
    ConfigError
        One line, unless `text` holds six finite numbers.
    """
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != 6 or not all(map(math.isfinite, values)):
        raise ConfigError(f"mount: must be six numbers 'x y z roll pitch yaw' in m and rad, got '{text}'")
    x, y, z, roll, pitch, yaw = values
    return Mount((x, y, z), _quaternion(roll, pitch, yaw))


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    sin_roll, cos_roll = math.sin(roll / 2), math.cos(roll / 2)
    sin_pitch, cos_pitch = math.sin(pitch / 2), math.cos(pitch / 2)
    sin_yaw, cos_yaw = math.sin(yaw / 2), math.cos(yaw / 2)
    return (
        sin_roll * cos_pitch * cos_yaw - cos_roll * sin_pitch * sin_yaw,
        cos_roll * sin_pitch * cos_yaw + sin_roll * cos_pitch * sin_yaw,
        cos_roll * cos_pitch * sin_yaw - sin_roll * sin_pitch * cos_yaw,
        cos_roll * cos_pitch * cos_yaw + sin_roll * sin_pitch * sin_yaw,
    )
