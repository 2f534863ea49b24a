# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.config import ConfigError
from posfet_model.ros.mount import parse_mount
from support.sweep import EPS, call_error


def rotation(axis: int, angle: float) -> np.ndarray:
    """Return the matrix of a right-handed rotation about a fixed axis."""
    a, b = [index for index in range(3) if index != axis]
    matrix = np.eye(3)
    sign = -1.0 if axis == 1 else 1.0
    matrix[a, a] = matrix[b, b] = math.cos(angle)
    matrix[a, b], matrix[b, a] = -sign * math.sin(angle), sign * math.sin(angle)
    return matrix


def turned(orientation: tuple[float, float, float, float], vector: np.ndarray) -> np.ndarray:
    """Return `vector` rotated by a unit quaternion x, y, z, w (Rodrigues' formula)."""
    axis, w = np.array(orientation[:3]), orientation[3]
    return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + w * vector)


@pytest.mark.parametrize(
    "angles", [(0, 0, 0), (0.3, 0, 0), (0, -0.7, 0), (0, 0, 2.0), (0.4, -1.1, 2.9), (3.0, 1.5, -2.0)]
)
def test_orientation_rotates_about_the_fixed_axes_in_order(angles: tuple[float, float, float]) -> None:
    mount = parse_mount("0.1 -0.2 0.3 " + " ".join(map(str, angles)))
    matrix = rotation(2, angles[2]) @ rotation(1, angles[1]) @ rotation(0, angles[0])
    assert mount.position == (0.1, -0.2, 0.3)
    # The norm is a product of three hypot(sin, cos), each with the error of one call, and of roundings of products
    # and sums.
    assert math.hypot(*mount.orientation) == pytest.approx(1.0, abs=3 * call_error() + 3 * EPS)
    for column, unit in zip(matrix.T, np.eye(3), strict=True):
        np.testing.assert_allclose(turned(mount.orientation, unit), column, rtol=0, atol=1e-14)


@pytest.mark.parametrize("text", ["", "0 0 0", "0 0 0 0 0 x", "0 0 0 0 0 nan", "0 0 inf 0 0 0", "0 0 0 0 0 0 1"])
def test_an_invalid_pose_is_rejected(text: str) -> None:
    with pytest.raises(ConfigError, match="mount: must be six numbers 'x y z roll pitch yaw' in m and rad"):
        parse_mount(text)
