# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How colours look in grey and to eyes with a colour vision deficiency, as numbers.

- sRGB to linear light and to CIE XYZ: IEC 61966-2-1. Lightness and distance: CIELAB of 1976 (CIE 15), white D65.
- Protanopia, deuteranopia and tritanopia: matrices at severity 1.0 for linear sRGB of Machado, Oliveira and Fernandes,
  A Physiologically-based Model for Simulation of Color Vision Deficiency, IEEE Trans. Vis. Comput. Graph. 15(6), 2009.
- Contrast: Web Content Accessibility Guidelines 2.1, relative luminance and contrast ratio.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NORMAL: Final = np.eye(3)
DEFICIENCIES: Final = {
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
_XYZ: Final = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE: Final = _XYZ.sum(axis=1)


def linear(colour: str) -> Array:
    """Return the linear light of a colour #rrggbb, shape [3]."""
    value = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(light: Array) -> Array:
    """Return L*, a* and b* of linear light."""
    ratio = _XYZ @ np.clip(light, 0, 1) / _WHITE
    root = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * root[1] - 16, 500 * (root[0] - root[1]), 200 * (root[1] - root[2])])


def least_distance(colours: tuple[str, ...], seen: Array = NORMAL) -> float:
    """Return the least distance of two colours in CIELAB, as seen with a deficiency [1]."""
    found = [lab(seen @ linear(colour)) for colour in colours]
    return min(float(np.linalg.norm(one - other)) for one, other in combinations(found, 2))


def least_grey_distance(colours: tuple[str, ...]) -> float:
    """Return the least difference of lightness L* of two colours [1]."""
    found = [float(lab(linear(colour))[0]) for colour in colours]
    return min(abs(one - other) for one, other in combinations(found, 2))


def contrast(colour: str, ground: str) -> float:
    """Return the contrast ratio of a colour on a ground, 1 to 21."""
    luminance = sorted(float(_XYZ[1] @ linear(each)) for each in (colour, ground))
    return (luminance[1] + 0.05) / (luminance[0] + 0.05)
