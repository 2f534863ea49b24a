# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import numpy as np
import pytest

from posfet.colour_scale import STEPS, colour, colours, hexadecimal, nice_scale

# Linear sRGB as seen without one kind of cones: H. Brettel et al., 1997, simplified by F. Vienot et al., 1999.
PROTANOPIA = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, -0.0], [0.00401, -0.00401, 1.0]])
DEUTERANOPIA = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, -0.0], [-0.02234, 0.02234, 1.0]])
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def linear() -> np.ndarray:
    encoded = colours() / 255.0
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("eyes", [np.eye(3), PROTANOPIA, DEUTERANOPIA], ids=["all cones", "protanopia", "deuteranopia"])
def test_more_force_is_lighter_for_all_eyes(eyes: np.ndarray) -> None:
    lightness = np.cbrt(linear() @ eyes.T @ LUMINANCE)
    step = STEPS // 16
    assert (lightness[step:] - lightness[:-step] > 0.02).all()


def test_levels_outside_have_the_nearest_colour() -> None:
    assert colour(-1.0) == colour(0.0) == tuple(colours()[0])
    assert colour(2.0) == colour(1.0) == tuple(colours()[-1])
    assert len(hexadecimal()) == len(set(hexadecimal())) == STEPS


@pytest.mark.parametrize(
    ("force", "scale"), [(0.2, 0.2), (0.20001, 0.5), (1.0, 1.0), (0.6, 1.0), (4.9, 5.0), (5.1, 10.0)]
)
def test_the_full_scale_is_a_round_number(force: float, scale: float) -> None:
    assert nice_scale(force) == pytest.approx(scale)
