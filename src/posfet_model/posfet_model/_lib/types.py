"""Array types that the whole package annotates with."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Array of float64."""

FloatArray: TypeAlias = NDArray[np.floating[Any]]
"""Array of float32 or float64."""

Mask: TypeAlias = NDArray[np.bool_]
"""Array of booleans."""
