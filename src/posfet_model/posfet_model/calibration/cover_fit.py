# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How the cover of a board spreads forces, as a mixture of Gaussians of several spreads.

Presses on all taxels determine the forces on each by all the others.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model.calibration.fit_steps import SLOW_SOURCES, FitSteps
from posfet_model.calibration.response_fit import ResponseFit

COVER_ROUNDS: Final = 4
"""Rounds in which cover and bending are found."""

COVER_LEAVES: Final = 0.75
"""A cover is taken if it leaves no more than this share of the squares that crosstalk under the sensor file's cover
leaves [1], assumed: layer and half space leave up to 0.13, and crosstalk that a cover explains 1.7 or more."""

LEAST_SHARE: Final = 0.03
"""A cover with less is left out [1]: as much is found where there is none, with all effects of a real film."""


def find_cover(steps: FitSteps, found: ResponseFit) -> ResponseFit:
    """Find how the cover spreads the forces, jointly with what a fit without it has found.

    Crosstalk and a cover that spreads more than the sensor file says look alike: only one of them is taken, the cover
    if it leaves clearly less. Bending looks like the tail of a cover, so each follows the other. What has hardly a
    share is left out.

    Parameters
    ----------
    steps : FitSteps
        What was found so far; its signals and forces are compensated and spread as is found.
    found : ResponseFit
        The fit so far.

    Returns
    -------
    ResponseFit
        The last fit.
    """
    bench = steps.bench
    if len(bench.cover) == 1:
        return found
    without, crosstalk = steps.fit_all(found), bench.crosstalk
    bench.compensate(0.0)
    kept = weak = list(range(len(bench.cover)))
    while weak and len(kept) > 1:
        for _ in range(COVER_ROUNDS):
            most = int(np.argmax(bench.cover))
            others = [index for index in kept if index != most]
            fitted = steps.fit_all(found, covers=(most, *others))
            found, change = fitted.without_common(SLOW_SOURCES), fitted.common[SLOW_SOURCES:]
            cover = bench.cover.copy()
            cover[others] += change
            cover[most] -= change.sum()
            bench.spread(cover)
            steps.find_bending(found)
            steps.find_common_mode(found)
            if np.abs(change).max() < 0.1 * LEAST_SHARE:
                break
        weak = [index for index in kept if bench.cover[index] < LEAST_SHARE]
        kept = [index for index in kept if index not in weak]
        if weak:
            bench.spread(np.where(bench.cover < LEAST_SHARE, 0.0, bench.cover))
    if kept != [0]:
        found, equal = steps.fit_all(found), dict.fromkeys(without.taxels, 1.0)
        if found.square_sum(equal) < COVER_LEAVES * without.square_sum(equal):
            return found
    bench.spread(np.eye(len(bench.cover))[0])
    bench.compensate(crosstalk)
    return without
