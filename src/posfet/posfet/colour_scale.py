# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Colours of forces: a path in the colour space OKLab along which lightness grows evenly with the force.

Order is then seen by lightness alone, so that it is the same for colour-blind eyes and on paper; hue helps all others.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

STEPS: Final = 256
"""Number of colours."""
_PATH: Final = np.array(
    [  # green-red and blue-yellow components of OKLab at even steps of lightness
        (0.00, -0.06),
        (0.07, -0.13),
        (0.15, -0.08),
        (0.16, 0.03),
        (0.10, 0.13),
        (0.00, 0.16),
        (-0.03, 0.11),
    ]
)
_LIGHTNESS: Final = 0.27, 0.95
"""Lightness of OKLab of no force and of full scale."""
_TO_CONES: Final = np.array(
    [[1.0, 0.3963377774, 0.2158037573], [1.0, -0.1055613458, -0.0638541728], [1.0, -0.0894841775, -1.2914855480]]
)
_TO_RGB: Final = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)
"""Matrices of B. Ottosson, "A perceptual color space for image processing", 2020: OKLab to linear sRGB."""


@cache
def colours() -> NDArray[np.uint8]:
    """Return the colours from no force to full scale as sRGB, shape [STEPS, 3]."""
    level = np.linspace(0.0, 1.0, STEPS)
    knots = np.linspace(0.0, 1.0, len(_PATH))
    low, high = _LIGHTNESS
    lab = np.stack([low + (high - low) * level, *(np.interp(level, knots, _PATH[:, i]) for i in (0, 1))], axis=1)
    linear = np.clip((lab @ _TO_CONES.T) ** 3 @ _TO_RGB.T, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    result: NDArray[np.uint8] = np.round(255.0 * encoded).astype(np.uint8)
    return result


def colour(level: float) -> tuple[int, int, int]:
    """Return the colour of a share of the full scale in [0, 1]; what is outside has the nearest colour.

    Parameters
    ----------
    level : float
        Force over the full scale [1]; not NaN.
    """
    red, green, blue = colours()[round(min(max(level, 0.0), 1.0) * (STEPS - 1))].tolist()
    return red, green, blue


def hexadecimal() -> list[str]:
    """Return all colours as texts #rrggbb."""
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colours().tolist()]


def nice_scale(force: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is not below a force.

    Parameters
    ----------
    force : float
        Force [N], > 0.

    Examples
    --------
    >>> [nice_scale(force) for force in (0.2, 0.21, 7.0)]
    [0.2, 0.5, 10.0]
    """
    power = float(10.0 ** np.floor(np.log10(force)))
    return next(float(f"{step * power:.1g}") for step in (1, 2, 5, 10) if step * power >= force * (1 - 1e-9))
