# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Steps of single signals, and how they differ from steps of the force."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from reference.estimation.zero_refutation import SURPRISING

HALF: Final = 7
"""Blocks on either side of a step, with one between them [1]."""

STEP: Final = 4.0
"""Deviations of a jump from which on it is a step [1]."""

MATCH: Final = 0.5
"""Part by which the change of slope may differ from the one that the step makes [1]."""


def signal_steps(time: Array, force: Array, variance: Array, tau: Array) -> Array:
    """Return the steps of single signals in the middle of a course of forces [N]; 0: none.

    A signal that steps has another offset from then on: the uncorrected force jumps by the step D, and its slope
    changes by D/tau. A force that jumps has the same slope before and after. Each half is fitted by a line. A force
    that moves has jumps on several taxels at once: where more than one jumps, no signal steps.

    Parameters
    ----------
    time : ndarray of float64, shape [2 * HALF + 1]
        Times [s].
    force : ndarray of float64, shape [2 * HALF + 1, taxels]
        Uncorrected forces [N].
    variance : ndarray of float64, shape [taxels]
        Least variance of their noise [N2]; what the lines do not fit is noise, too.
    tau : ndarray of float64, shape [taxels]
        Leakage time constants [s].
    """
    since = time - time[HALF]
    value, slope, left = [], [], np.zeros_like(tau)
    jump_share, slope_share = 0.0, 0.0
    for part in (slice(0, HALF), slice(HALF + 1, None)):
        at = since[part]
        centred = at - at.mean()
        square = float(centred @ centred)
        mean = force[part].mean(axis=0)
        rate = centred @ force[part] / square
        residual = force[part] - mean - np.multiply.outer(centred, rate)
        left += (residual * residual).sum(axis=0)
        value.append(mean - rate * at.mean())
        slope.append(rate)
        jump_share += 1.0 / HALF + float(at.mean()) ** 2 / square
        slope_share += 1.0 / square
    noise = np.maximum(variance, left / (2 * HALF - 4))
    jump, bend = value[1] - value[0], slope[1] - slope[0]
    jumps = jump * jump > STEP**2 * jump_share * noise
    if np.count_nonzero(jumps) != 1:
        return np.zeros_like(jump)
    expected = jump / tau
    told = expected * expected > SURPRISING**2 * slope_share * noise
    step: Array = np.where(jumps & told & (np.abs(bend - expected) < MATCH * np.abs(expected)), jump, 0.0)
    return step
