# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""First-order linear systems, exact over steps of any length: mean decay over a step, and linear recurrences."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_BLOCK_ELEMENTS: Final = 1 << 14  # a block and its copies fit into the processor's cache

_WIDE: Final = 512  # elements of a row from which a loop over rows is faster

_NEGLIGIBLE: Final = 1e-25  # factor of an earlier row that is below rounding in float64


def linear_recurrence(factor: NDArray[Any], addend: NDArray[Any], start: NDArray[Any]) -> NDArray[Any]:
    """Return x with ``x[k] = factor[k]*x[k-1] + addend[k]`` and ``x[-1] = start``.

    Parameters
    ----------
    factor : ndarray
        Of the shape of `addend` or [t, 1]; |factor| <= 1 is needed for accuracy.
    addend : ndarray
        Shape [t] or [t, n]; overwritten by the result.
    start : ndarray
        Initial value, of the shape of one row.

    Returns
    -------
    ndarray
        x, in the memory of `addend`.

    Notes
    -----
    The series is divided into blocks. Within a block, neighbouring rows are merged into rows of twice the reach until
    each reaches the start of the block, or so far back that the contribution is negligible (Kogge and Stone 1973). That
    takes log2 passes of whole-array arithmetic instead of a loop. Wide rows are processed in a loop, one pass each.
    """
    result, row = addend, start
    if start.size >= _WIDE:
        for k in range(len(result)):
            row = np.add(factor[k] * row, result[k], out=result[k, ...])
        return result
    rows = max(1, _BLOCK_ELEMENTS // max(1, start.size))
    for begin in range(0, len(result), rows):
        block = slice(begin, begin + rows)
        _solve_block(factor[block], row, result[block])
        row = result[block][-1]
    return result


def _solve_block(factor: NDArray[Any], start: NDArray[Any], result: NDArray[Any]) -> None:
    """Solve one block, in place."""
    result[0] += factor[0] * start
    product, reach = factor, 1
    while reach < len(result) and np.abs(product).max(initial=0.0) > _NEGLIGIBLE:
        result[reach:] += product[reach:] * result[:-reach]
        product = np.concatenate([product[:reach], product[reach:] * product[:-reach]])
        reach *= 2


_TINY: Final = 1e-20  # below, the result rounds to 1, and complex division would approach underflow


def mean_decay(x: NDArray[Any]) -> NDArray[Any]:
    """Return ``(1 - exp(-x))/x``, the mean of exp(-x*s) over s in [0, 1]; 1 at x = 0.

    The response of a first-order lag to a linear piece of input: over a step h with a time constant tau, an input that
    rises by 1 leads the output by ``mean_decay(h/tau)``.

    Parameters
    ----------
    x : ndarray
        Any shape, real or complex, real part >= 0.

    Returns
    -------
    ndarray
        Of the shape of x; accurate to 4 units in the last place.
    """
    tiny = np.abs(x) < _TINY
    safe = np.where(tiny, 1, x).astype(x.dtype)
    result: NDArray[Any] = np.where(tiny, 1, -np.expm1(-safe) / safe).astype(x.dtype)
    return result
