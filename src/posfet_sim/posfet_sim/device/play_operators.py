# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Play operators: the elements of a Prandtl-Ishlinskii model of rate-independent hysteresis."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array


def play_outputs(force: Array, before: Array, half_widths: Array) -> Array:
    """Return the outputs of play operators, which follow a force at the distance of at most their half-widths.

    A. Visintin, Differential Models of Hysteresis, 1994, ch. III.

    Parameters
    ----------
    force : numpy.ndarray
        Force [N], shape [samples, taxels].
    before : numpy.ndarray
        Outputs before the first sample [N], shape [plays, taxels].
    half_widths : numpy.ndarray
        Half-widths [N], shape [plays, 1].

    Returns
    -------
    numpy.ndarray
        Outputs at each sample [N], shape [samples, plays, taxels].
    """
    lower, upper = force[:, None] - half_widths, force[:, None] + half_widths
    if (lower <= before).all() and (before <= upper).all():  # no play moves
        return np.broadcast_to(before, lower.shape)
    plays = np.empty_like(lower)
    for low, high, after in zip(lower, upper, plays, strict=True):
        np.maximum(before, low, out=after)
        np.minimum(after, high, out=after)
        before = after
    return plays
