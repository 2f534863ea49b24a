"""Arguments of one function brought to one floating-point type, their shapes checked against each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from posfet_model.checks import FloatArray


def alike(**arrays: FloatArray) -> tuple[FloatArray, ...]:
    """Return the arrays in their common type: float32 when all are float32, else float64; the order is kept.

    NumPy before 2.0 lets the *value* of a 0-d array decide about the type of a sum; the conversion made here beforehand
    gives every release the same result. Raises ValueError, naming arguments and shapes, when the shapes do not
    broadcast together.
    """
    try:
        np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ValueError(f"shapes must broadcast together, got {shapes}") from None
    dtype: np.dtype[Any] = np.result_type(*(array.dtype for array in arrays.values()))
    return tuple(array.astype(dtype, copy=False) for array in arrays.values())
