"""The force image of one scan, and the projection of contact forces onto values that are not negative."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


def non_negative(force: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return forces [N] that are not negative, as near as can be to those given, with the same sum.

    Near by the sum of ``(answer - force)^2/variance``, variance [N2] > 0 of each, shapes [k]: the answer is
    ``max(force - theta*variance, 0)``, theta found by dropping what falls below zero (C. Michelot, J. Optim. Theory
    Appl. 50, 195, 1986). Where the sum is not positive there is no such answer but zeros. With a share c of crosstalk
    errors of neighbours go together by about 2*c, which is left out: that moves a force by at most about 8*c of the
    greatest one below zero.

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


@dataclass(slots=True)
class ForceImage:
    """Forces of all taxels, shapes [rows * cols], row by row.

    A reconstructor reuses the same object for every image: `snapshot` returns a copy that stays.
    """

    force: NDArray[np.float32]
    """[N], positive when pushed; not negative in and around contacts; NaN: not known."""
    standard_deviation: NDArray[np.float32]
    """[N]; NaN: not known."""
    status: NDArray[np.uint8]
    """Values of TaxelStatus."""
    total: float
    """Sum of the known forces [N]; NaN: none is known."""
    total_standard_deviation: float
    """[N]; NaN: not known."""

    def snapshot(self) -> ForceImage:
        """Return an independent copy, which the next image does not overwrite."""
        return replace(
            self,
            force=self.force.copy(),
            standard_deviation=self.standard_deviation.copy(),
            status=self.status.copy(),
        )
