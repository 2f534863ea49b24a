# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sums in the order of the values.

Contacts that share a region follow from those of the scan before: the least differences of rounding would grow from
scan to scan.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def sum_in_order(values: NDArray[np.float64], axis: int = 0) -> NDArray[np.float64]:
    """Return the sums along an axis, each value added to the sum of those before it."""
    if not values.shape[axis]:
        return np.zeros(values.shape[:axis] + values.shape[axis + 1 :])
    return np.asarray(np.cumsum(values, axis=axis).take(-1, axis=axis))
