"""Arguments of one function brought to one floating-point type, their shapes checked against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from posfet_model.checks import FloatArray


def alike(**arrays: FloatArray) -> tuple[FloatArray, ...]:
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


def some(mask: NDArray[np.bool_]) -> bool:
    """Return whether any is true: `mask.any()`, which for a small array takes ten times as long."""
    return 1 in mask.tobytes()
