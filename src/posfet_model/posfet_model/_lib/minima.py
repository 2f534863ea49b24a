# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Minimum of a function in a bracket."""

from __future__ import annotations

import math
from collections.abc import Callable


def golden_section(function: Callable[[float], float], low: float, high: float, steps: int) -> float:
    """Return where a function with a single minimum between two positions is least, by golden-section search.

    Parameters
    ----------
    function : callable
        The function at one position.
    low, high : float
        Ends of the bracket.
    steps : int
        Evaluations after the first two; each leaves 0.618 of the bracket, whose middle is returned.

    Examples
    --------
    >>> round(golden_section(lambda at: (at - 0.3) ** 2, 0.0, 1.0, 20), 3)
    0.3
    """
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    left, right = high - golden * (high - low), low + golden * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(steps):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - golden * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + golden * (high - low)
            at_right = function(right)
    return 0.5 * (low + high)
