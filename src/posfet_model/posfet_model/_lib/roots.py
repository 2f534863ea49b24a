# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Roots of many functions at once, each in a bracket of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from posfet_model._lib.types import Array, FloatArray


def false_position(function: Callable[[Array], Array], inside: Array, outside: Array, steps: int) -> Array:
    """Return where functions cease to be positive, each in a bracket of its own, by false position; unchecked.

    The Illinois rule halves the value of an end that stays twice (M. Dowell, P. Jarratt, BIT 11 (1971) 168,
    doi:10.1007/BF01934364). Without a usable value at either end, and where three steps did not halve the bracket, the
    bracket is halved; NaN counts as not positive.

    Parameters
    ----------
    function : callable
        The functions at one position each, shape [n].
    inside, outside : ndarray
        Ends of the brackets, in either order, shape [n]; the functions are positive at `inside`.
    steps : int
        Evaluations between the ends.

    Returns
    -------
    ndarray
        Positions, interpolated in the last brackets, shape [n].
    """
    at_inside, at_outside = function(inside), function(outside)
    last: FloatArray = np.zeros_like(at_inside)  # 1 where the inner end was the last to move, -1 for the outer
    widths = [np.full(at_inside.shape, np.inf)] * 3
    weight: tuple[FloatArray, FloatArray] = (np.ones_like(at_inside), np.ones_like(at_inside))
    for _ in range(steps):
        width = np.abs(outside - inside)
        share = _share(at_inside * weight[0], at_outside * weight[1])
        middle = inside + np.where(width > 0.5 * widths[0], 0.5, share) * (outside - inside)
        widths = [*widths[1:], width]
        value = function(middle)
        good = value > 0
        stays = np.where(np.where(good, 1.0, -1.0) == last, 0.5, 1.0)
        weight = np.where(good, 1.0, weight[0] * stays), np.where(good, weight[1] * stays, 1.0)
        at_inside, at_outside = np.where(good, value, at_inside), np.where(good, at_outside, value)
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
        last = np.where(good, 1.0, -1.0)
    return inside + _share(at_inside, at_outside) * (outside - inside)


def _share(at_inside: FloatArray, at_outside: FloatArray) -> FloatArray:
    """Return how far between the ends of a bracket a straight line is 0 [1]; a half where it is not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = at_inside / (at_inside - at_outside)
    return np.where((share >= 0) & (share <= 1), share, 0.5)
