"""Checks of arguments: what a physical function accepts, said in one line when it is not given."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray

_Kind = TypeVar("_Kind")


def interval(low: float, high: float, exclusive: bool = False) -> str:
    """Return an interval as it is written: closed ends in brackets, open and infinite ends in parentheses."""
    left = "(" if exclusive or math.isinf(low) else "["
    right = ")" if exclusive or math.isinf(high) else "]"
    return f"{left}{low:g}, {high:g}{right}"


def real_array(
    name: str, value: ArrayLike, low: float = -math.inf, high: float = math.inf, *, exclusive: bool = False
) -> FloatArray:
    """Return `value` as a floating-point array, any shape; float32 stays float32, everything else becomes float64.

    Raises ValueError, naming the argument, its range and the first offending value, when `value` is not numeric, is
    complex, is not finite, or leaves the closed interval [low, high] (open with `exclusive`).
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{name} must be a whole array of real numbers, got {value!r:.60}") from None
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be real numbers, got {value!r:.60} of type {array.dtype}")
    if array.dtype != np.float32:
        array = array.astype(np.float64, copy=False)
    inside = (array > low) & (array < high) if exclusive else (array >= low) & (array <= high)
    inside &= np.isfinite(array)
    if not inside.all():
        offender = array[~inside].flat[0] if array.ndim else array[()]
        raise ValueError(f"{name} must be in {interval(low, high, exclusive)}, got {float(offender):g}")
    return array


def real_number(
    name: str, value: float, low: float = -math.inf, high: float = math.inf, *, exclusive: bool = False
) -> float:
    """Return `value` as a float; the same checks as `real_array`, and ValueError when it is not a scalar."""
    array = real_array(name, value, low, high, exclusive=exclusive)
    if array.ndim:
        raise ValueError(f"{name} must be a single number, got an array of shape {array.shape}")
    return float(array)


def whole_number(name: str, value: int, low: int, high: int) -> int:
    """Return `value` as an int; ValueError when it is not a whole number in [low, high]."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise ValueError(f"{name} must be a whole number in [{low}, {high}], got {value!r:.60}")
    if not low <= value <= high:
        raise ValueError(f"{name} must be in [{low}, {high}], got {value}")
    return int(value)


def instance(name: str, value: object, kind: type[_Kind]) -> _Kind:
    """Return `value`; ValueError when it is not of the class `kind`."""
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be a {kind.__name__}, got {value!r:.60}")
    return value


def common_dtype(**arrays: FloatArray) -> tuple[FloatArray, ...]:
    """Return the arrays in their common type, in the same order: float32 when all are float32, else float64.

    Scalars (0-d) count only when there is nothing else, so that a float32 frame stays float32 beside float parameters.
    The conversion is made here because NumPy before 2.0 and after have different rules for scalars. Raises ValueError,
    naming arguments and shapes, when the shapes do not broadcast together.
    """
    try:
        np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ValueError(f"shapes must broadcast together, got {shapes}") from None
    deciding = [array for array in arrays.values() if array.ndim] or arrays.values()
    dtype: np.dtype[Any] = np.result_type(*(array.dtype for array in deciding))
    return tuple(array.astype(dtype, copy=False) for array in arrays.values())
