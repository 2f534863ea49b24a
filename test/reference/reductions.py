# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reductions of small arrays, faster than NumPy's own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def upper_median(values: NDArray[Any]) -> float:
    """Return the upper median of values of shape [n]; 0 for none.

    np.median takes ten times as long, and its first call loads another library.

    Parameters
    ----------
    values : ndarray, shape [n]
        Values.
    """
    return float(np.sort(values)[len(values) // 2]) if len(values) else 0.0


def median(values: NDArray[Any]) -> float:
    """Return the median of values of shape [n], n > 0; np.median takes ten times as long.

    Parameters
    ----------
    values : ndarray, shape [n]
        Values.
    """
    ordered, half = np.sort(values), len(values) // 2
    return float(ordered[half]) if len(values) % 2 else 0.5 * float(ordered[half - 1] + ordered[half])


def any_true(mask: NDArray[np.bool_]) -> bool:
    """Return whether any element is true.

    Like `mask.any()`, which takes ten times as long for a small array.

    Parameters
    ----------
    mask : ndarray of bool
        Mask of any shape.
    """
    return 1 in mask.tobytes()
