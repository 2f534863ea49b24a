# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Force image of one scan, and the projection of contact forces onto non-negative values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


def non_negative(force: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the non-negative forces with the same sum that are closest to the given ones.

    Minimises ``sum((result - force)^2/variance)``: the result is ``max(force - theta*variance, 0)``, with theta found
    by removing negative values iteratively. Where the sum is not positive, the result is zero. Crosstalk with a share
    c correlates the errors of neighbours by about 2*c, which is neglected: this changes a force by at most about 8*c
    of the greatest negative one.

    Parameters
    ----------
    force : ndarray of float64, shape [k]
        Forces [N].
    variance : ndarray of float64, shape [k]
        Variance of each force [N2], > 0.

    Returns
    -------
    ndarray of float64, shape [k]
        Forces >= 0 [N].

    References
    ----------
    C. Michelot, J. Optim. Theory Appl. 50, 195, 1986.

    Examples
    --------
    >>> non_negative(np.array([1.0, 0.5, -0.25]), np.ones(3)).tolist()
    [0.875, 0.375, 0.0]
    """
    total = float(force.sum())
    if total <= 0.0:
        return np.zeros(len(force))
    theta, kept = 0.0, force > 0.0
    for _ in range(len(force)):
        theta = (float(force @ kept) - total) / float(variance @ kept)
        still = force > theta * variance
        if still.sum() == kept.sum():
            break
        kept = still
    nearest: NDArray[np.float64] = np.maximum(force - theta * variance, 0.0)
    return nearest


@dataclass(slots=True, eq=False)
class ForceImage:
    """Forces of all taxels, shapes [rows * cols], row by row.

    A reconstructor reuses the same object for every image: `snapshot` returns a copy that stays.
    """

    force: NDArray[np.float32]
    """Force [N], positive when pushed; non-negative in and around contacts; NaN: unknown."""
    standard_deviation: NDArray[np.float32]
    """Standard uncertainty of each force [N]; NaN: unknown."""
    status: NDArray[np.uint8]
    """Values of TaxelStatus."""
    load: NDArray[np.float64]
    """Force of each taxel in sums such as `total` [N]: as `force`; of faulty taxels an own reading that is still
    informative, or, while there is a contact, the interpolation by their neighbours; where these tell nothing, NaN in a
    contact; 0: not known, and in no contact."""
    load_variance: NDArray[np.float64]
    """Variance of each load without what the errors have in common [N2]."""
    total: float
    """Sum of the loads [N]; NaN: all forces are unknown, or that of a contact is."""
    total_standard_deviation: float
    """Standard uncertainty of the sum [N]; NaN: unknown."""

    @classmethod
    def unknown(cls, taxels: int) -> ForceImage:
        """Return an image in which nothing is known.

        Parameters
        ----------
        taxels : int
            Number of taxels.
        """
        nan = np.full(taxels, np.nan, np.float32)
        zeros = np.zeros(taxels)
        return cls(nan, nan.copy(), np.zeros(taxels, np.uint8), zeros, zeros.copy(), math.nan, math.nan)

    def snapshot(self) -> ForceImage:
        """Return an independent copy, which the next image does not overwrite."""
        return replace(
            self,
            force=self.force.copy(),
            standard_deviation=self.standard_deviation.copy(),
            status=self.status.copy(),
            load=self.load.copy(),
            load_variance=self.load_variance.copy(),
        )
