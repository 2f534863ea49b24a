# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Validation of the arguments of physical functions; an error is one line that names the argument and its range."""

from __future__ import annotations

import math
import sys
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.shown import interval
from posfet_model._lib.types import FloatArray

_Kind = TypeVar("_Kind")


def real_array(
    name: str, value: ArrayLike, low: float = -math.inf, high: float = math.inf, *, exclusive: bool = False
) -> FloatArray:
    """Return `value` as a floating-point array; float32 stays float32, everything else becomes float64.

    Parameters
    ----------
    name : str
        Name of the argument, for the error.
    value : array_like
        Value of the argument, any shape.
    low, high : float
        Closed interval of allowed values.
    exclusive : bool, default False
        Whether the interval is open.

    Returns
    -------
    ndarray
        The value, float32 or float64.

    Raises
    ------
    ValueError
        The value is not numeric, is complex, not finite or out of range. The message names the argument, its range and
        the first invalid value. A masked array is rejected too: its hidden values would be calculated with.
    """
    array = real_values(name, value)
    inside = (array > low) & (array < high) if exclusive else (array >= low) & (array <= high)
    inside &= np.isfinite(array)
    if not inside.all():
        offender = array[~inside].flat[0] if array.ndim else array[()]
        raise ValueError(f"{name} must be in {interval(low, high, exclusive)}, got {float(offender):g}")
    return array


def real_values(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a floating-point array, which may have values that are not finite.

    Parameters
    ----------
    name : str
        Name of the argument, for the error.
    value : array_like
        Value of the argument, any shape.

    Returns
    -------
    ndarray
        The value, float32 or float64.

    Raises
    ------
    ValueError
        The value is not numeric, is complex, or is masked.
    """
    if _masked(value):
        raise ValueError(f"{name} must be without a mask, got a masked array; use .filled(value) or .compressed()")
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{name} must be a whole array of real numbers, got {value!r:.60}") from None
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be real numbers, got {value!r:.60} of type {array.dtype}")
    return array if array.dtype == np.float32 else array.astype(np.float64, copy=False)


def _masked(value: object) -> bool:
    """Return whether `value` is a masked array, or a list or tuple of some."""
    masked = sys.modules.get("numpy.ma")  # loaded by whoever makes a masked array
    parts = value if isinstance(value, (list, tuple)) else (value,)
    return masked is not None and any(isinstance(part, masked.MaskedArray) for part in parts)


def real_number(
    name: str, value: float, low: float = -math.inf, high: float = math.inf, *, exclusive: bool = False
) -> float:
    """Return `value` as a float.

    Parameters
    ----------
    name : str
        Name of the argument, for the error.
    value : float
        Value of the argument.
    low, high : float
        Closed interval of allowed values.
    exclusive : bool, default False
        Whether the interval is open.

    Returns
    -------
    float
        The value.

    Raises
    ------
    ValueError
        The value is not a scalar, or `real_array` rejects it.
    """
    array = real_array(name, value, low, high, exclusive=exclusive)
    if array.ndim:
        raise ValueError(f"{name} must be a single number, got an array of shape {array.shape}")
    return float(array)


def whole_number(name: str, value: int, low: int, high: int) -> int:
    """Return `value` as an int.

    Parameters
    ----------
    name : str
        Name of the argument, for the error.
    value : int
        Value of the argument.
    low, high : int
        Closed interval of allowed values.

    Returns
    -------
    int
        The value.

    Raises
    ------
    ValueError
        The value is not a whole number in the interval.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise ValueError(f"{name} must be a whole number in [{low}, {high}], got {value!r:.60}")
    if not low <= value <= high:
        raise ValueError(f"{name} must be in [{low}, {high}], got {value}")
    return int(value)


def instance(name: str, value: object, kind: type[_Kind]) -> _Kind:
    """Return `value`; ValueError when it is not an instance of the class `kind`.

    Parameters
    ----------
    name : str
        Name of the argument, for the error message.
    value : object
        Value to check.
    kind : type
        Required class.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be a {kind.__name__}, got {value!r:.60}")
    return value


def common_dtype(**arrays: FloatArray) -> tuple[FloatArray, ...]:
    """Return the arrays with their common dtype: float32 when all are float32, else float64.

    Scalars (0-d) count only if there are no arrays, so that a float32 frame stays float32 with float parameters. The
    conversion is made here because the promotion rules for scalars differ between NumPy before and after 2.0.

    Parameters
    ----------
    **arrays : ndarray
        Arrays by the name of the argument.

    Returns
    -------
    tuple of ndarray
        Arrays in the same order.

    Raises
    ------
    ValueError
        The shapes do not broadcast together; the message names arguments and shapes.
    """
    try:
        np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ValueError(f"shapes must broadcast together, got {shapes}") from None
    deciding = [array for array in arrays.values() if array.ndim] or arrays.values()
    dtype: np.dtype[Any] = np.result_type(*(array.dtype for array in deciding))
    return tuple(array.astype(dtype, copy=False) for array in arrays.values())
