# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Fit of the bending of the chip: charge that forces on other taxels make on an untouched one.

With the place (x, y) of a taxel, from -1 to 1 at the edges of the array, and forces F_i at (x_i, y_i), the charge is
that of a force::

    p*B*sum(F_i) + (B_x*x + B_y*y)*sum(F_i) + B_m*(x*sum(F_i*x_i) + y*sum(F_i*y_i))

The profile p of the taxels, which is 1 on average, is that of the chip on its mount: a chip that is held at its edges
bends most in the middle. What presses beside the array may bend the chip, too; that is a source of its own, as no force
of a taxel is known to do so in use.

Fitted to differences of consecutive blocks, in which temperatures hardly change while a press rises or falls. What the
recording does not show stays 0, with the deviation of an uncalibrated sensor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.leaky_response import low_pass
from posfet_model.calibration.taxel_calibration import CHIP_WARMING_TIMES, NOMINAL_BENDING_DEVIATION
from posfet_model.sensor.description import Layout

PROFILE_PRIOR: Final = 0.5
"""Standard deviation of a taxel's part p of the bending [1], and"""

LEAST_BENDING: Final = 0.5e-3
"""bending below which it is not told from other causes [1]; both assumed."""

WARMING_DEVIATION: Final = 0.1
"""Standard deviation of the size of the warming with each of `CHIP_WARMING_TIMES` [K/N], assumed."""

BENDS: Final = len(NOMINAL_BENDING_DEVIATION)
"""Number of sizes of the bending."""

CROSSTALK_DEVIATION: Final = 0.02
"""Standard deviation of the crosstalk that is left after its compensation [1], assumed."""

PRIOR_DEVIATIONS: Final = (
    *NOMINAL_BENDING_DEVIATION,
    *(WARMING_DEVIATION for _ in CHIP_WARMING_TIMES),
    NOMINAL_BENDING_DEVIATION[0],  # of what presses beside the array
    CROSSTALK_DEVIATION,
)
"""Standard deviations of the sizes of all sources [1]."""


@dataclass(frozen=True, eq=False)
class BendingFit:
    """Result of the fit."""

    sizes: Array
    """B, B_x, B_y and B_m [1], shape [4]."""
    deviations: Array
    """Their standard deviations [1], shape [4]."""
    warming: Array
    """By how much an object warms the chip with each of `CHIP_WARMING_TIMES`, per total force [K/N], shape [3]."""
    profile: Array
    """Part p of each of the taxels that were given in the bending [1], shape [taxels]."""


class BendingSources:
    """Forces of a recording as the sources of what an untouched taxel shows."""

    def __init__(self, layout: Layout, time: Array, force: Array, beside: Array, film_lag: float) -> None:
        """Take times [s] and forces on the taxels and beside them [N], one row per scan, and the film's lag [s]."""
        row, col = np.divmod(np.arange(layout.taxels), layout.cols)
        self._places = np.stack([np.ones(layout.taxels), _places(col, layout.cols), _places(row, layout.rows)])
        self._total, *self._moments = self._places @ force.T
        self._beside = beside
        self._slow = [low_pass(time, low_pass(time, self._total, pole), film_lag) for pole in CHIP_WARMING_TIMES]

    def of_bending(self, taxel: int, part: float = 1.0) -> Array:
        """Return the sources of bending of a taxel with its part p of it [N], shape [scans, 4]."""
        _, x, y = self._places[:, taxel]
        moment = self._moments[0] * x + self._moments[1] * y
        return np.stack([part * self._total, self._total * x, self._total * y, moment], axis=1)

    def of_all(self, taxel: int, newton_per_kelvin: float, neighbours: Array) -> Array:
        """Return the sources of what an untouched taxel shows [N, N2/K], as in `PRIOR_DEVIATIONS`, a row per scan."""
        slow = [newton_per_kelvin * each for each in self._slow]
        return np.column_stack([self.of_bending(taxel), *slow, self._beside, neighbours])


@dataclass(frozen=True, eq=False)
class UntouchedTaxel:
    """What a taxel shows while it is untouched."""

    charge: Array
    """Charge as a force, leakage compensated [N], shape [blocks]."""
    sources: Array
    """Sources of its charge [N], shape [blocks, sources]."""
    used: Mask
    """Blocks in which it is untouched while others are pressed, shape [blocks]."""
    noise: float
    """Standard deviation of a block [N]."""


def fit_bending(taxels: Iterable[UntouchedTaxel]) -> BendingFit:
    """Fit the bending to what untouched taxels show.

    Parameters
    ----------
    taxels : iterable of UntouchedTaxel
        Taxels that respond.

    Returns
    -------
    BendingFit
        Sizes and standard deviations.
    """
    sources = len(PRIOR_DEVIATIONS)
    rows, values, blocks = [np.zeros((0, sources))], [np.zeros(0)], [np.zeros(0, np.intp)]
    ends = [0]
    for each in taxels:
        used = np.flatnonzero(each.used[1:] & each.used[:-1])
        weight = 1.0 / (math.sqrt(2.0) * each.noise)
        rows.append(weight * np.diff(each.sources, axis=0)[used])
        values.append(weight * np.diff(each.charge)[used])
        blocks.append(used)
        ends.append(ends[-1] + len(used))
    system, value, block = np.concatenate(rows), np.concatenate(values), np.concatenate(blocks)
    prior = np.diag(np.square(PRIOR_DEVIATIONS) ** -1.0)
    information, moment = np.einsum("ij,ik->jk", system, system), np.einsum("ij,i->j", system, value)
    left = value - system @ np.linalg.solve(information + prior, moment)
    # What all taxels show at once, as a temperature that changes, is no independent noise of each.
    scores = [np.bincount(block, column * left) for column in system.T]
    scatter = max(
        1.0, float(np.sum(np.square(scores[:BENDS]))) / max(float(np.trace(information[:BENDS, :BENDS])), 1e-9)
    )
    covariance: Array = np.linalg.inv(information / scatter + prior)
    sizes: Array = (covariance @ moment) / scatter
    left = value - system @ sizes
    parts = [slice(*each) for each in pairwise(ends)]
    profile = np.array([_part_of(system[each, 0], left[each], float(sizes[0]), scatter) for each in parts])
    warming = sizes[BENDS : BENDS + len(CHIP_WARMING_TIMES)]
    return BendingFit(sizes[:BENDS], np.sqrt(np.diag(covariance))[:BENDS], warming, profile)


def _part_of(total: Array, left: Array, size: float, scatter: float) -> float:
    """Return the part p of a taxel in a bending B, from what that leaves of its charge for the total force."""
    prior = scatter / (PROFILE_PRIOR**2 * (size**2 + LEAST_BENDING**2))
    differs = float(total @ left) / (float(total @ total) + prior)
    return 1.0 + differs * size / (size**2 + LEAST_BENDING**2)


def _places(index: NDArray[np.intp], count: int) -> Array:
    """Return places from -1 to 1, for indices of rows or columns."""
    half = 0.5 * (count - 1)
    places: Array = (index.astype(np.float64) - half) / max(half, 0.5)
    return places
