# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Force maps of the fingertips as a picture."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

SIDE: Final = 32
"""Side of a taxel in the picture [pixel]."""
BACKGROUND: Final = (24, 24, 32)
"""Colour between the maps (red, green, blue)."""
STOPS: Final = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], np.float64)
"""Colours from no force to the largest one, at equal distances: safe for colour-blind eyes."""


def picture(force: NDArray[np.float32], largest: float) -> NDArray[np.uint8]:
    """Return force maps side by side, the first row of each at the bottom, because y points up.

    Parameters
    ----------
    force : ndarray of float32, shape [maps, rows, cols]
        Force on each taxel [N].
    largest : float
        Force of the last colour [N]; a quarter of it has that of the middle.

    Returns
    -------
    ndarray of uint8, shape [height, width, 3]
        Red, green and blue.
    """
    at = np.sqrt(np.clip(force / largest, 0.0, 1.0)) * (len(STOPS) - 1)
    colours = np.stack([np.interp(at, np.arange(len(STOPS)), STOPS[:, part]) for part in range(3)], axis=-1)
    maps = np.kron(colours[:, ::-1], np.ones((1, SIDE, SIDE, 1)))
    gap = np.full((maps.shape[1], SIDE // 2, 3), BACKGROUND)
    parts = [part for each in maps for part in (gap, each)][1:]
    whole: NDArray[np.uint8] = np.concatenate(parts, axis=1).round().astype(np.uint8)
    return whole
