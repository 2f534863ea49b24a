"""Functions of exp(-x) that keep their relative accuracy at small x, for exact steps of linear systems."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_TINY: Final = 1e-20  # below, the result is 1 to rounding, and complex division would come near underflow


def mean_decay(x: NDArray[Any]) -> NDArray[Any]:
    """Return ``(1 - exp(-x))/x``, the mean of exp(-x*s) over s in [0, 1]; 1 at x = 0. Any shape, real part >= 0.

    What a first-order lag makes of a straight piece of input: over a step h with a time constant tau, an input that
    rises by 1 leaves the lag ``mean_decay(h/tau)``. Right to 4 units in the last place; x may be complex.
    """
    tiny = np.abs(x) < _TINY
    safe = np.where(tiny, 1, x).astype(x.dtype)
    result: NDArray[Any] = np.where(tiny, 1, -np.expm1(-safe) / safe).astype(x.dtype)
    return result
