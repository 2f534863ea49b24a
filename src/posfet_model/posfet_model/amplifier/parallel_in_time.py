# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One stable system over a long input, in many stretches of time at once: parallel in time, by multiple shooting.

An array of systems takes little longer for a step than one does. Each stretch starts at rest at first, then at the end
of the one before it, until it meets its first result, since a stable system forgets: then that result is right from
there on. J. Nievergelt, Commun. ACM 7 (1964) 731, doi:10.1145/355588.365137.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model.amplifier.transient import System, SystemState, advance_together

LEAST_INTERVALS: Final = 512
"""Intervals below which stretches of time are not worth it."""

STRETCH: Final = 200
"""Least intervals of a stretch, far more than a system remembers."""

MOST_STRETCHES: Final = 256

MEETING: Final = 0.1
"""Largest difference of the two results where they meet [tolerance]."""


def advance_stretches(
    system: System, state: SystemState, v_in: Array, durations: Array, tolerance: float
) -> tuple[SystemState, Array] | None:
    """Return the state after intervals in which the input changed linearly, and the nodes at their ends. Unchecked.

    Parameters
    ----------
    system : System
        A single system.
    state : SystemState
        State at the start, of shape ().
    v_in : ndarray
        Input at the end of each interval [V], shape [t].
    durations : ndarray
        Lengths of the intervals [s], shape [t]; 0 is a jump.
    tolerance : float
        Largest difference of the two orders in a step [V].

    Returns
    -------
    tuple or None
        State after the last whole stretch, and voltages of the nodes up to there [V], shape [k, n], k <= t; None where
        a stretch does not meet its first result: the system remembers too long for this, or has no rest.
    """
    stretches = min(MOST_STRETCHES, v_in.size // STRETCH)
    rows = v_in.size // max(stretches, 1)
    if stretches < 2:
        return None
    ends = v_in[: rows * stretches].reshape(stretches, rows).T
    each = durations[: rows * stretches].reshape(stretches, rows).T
    before = np.concatenate([[state.v_in], ends[-1, :-1]])
    rest = system.operating_point(before)
    if not np.isfinite(rest).all():
        return None
    found = np.empty((rows, *rest.shape))
    now = SystemState(before, rest, state.step)
    for row in range(rows):
        now, found[row] = advance_together(system, now, ends[row], each[row], tolerance)
    now = SystemState(before, np.concatenate([state.nodes[None], found[-1, :-1]]), state.step)
    for row in range(rows):
        first = found[row].copy()
        now, found[row] = advance_together(system, now, ends[row], each[row], tolerance)
        if np.abs(found[row] - first).max() <= MEETING * tolerance:
            return SystemState(ends[-1, -1], found[-1, -1], now.step), found.swapaxes(0, 1).reshape(-1, rest.shape[-1])
    return None
