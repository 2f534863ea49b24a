# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Fields that several messages have."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray

from posfet_model._lib.units import NANOSECONDS

LARGEST_INT32: Final = 0x7FFF_FFFF


def set_stamp(stamp: Time, nanoseconds: int) -> None:
    """Set the time of a message to `nanoseconds` since the Unix epoch.

    Parameters
    ----------
    stamp : Time
        Field to set.
    nanoseconds : int
        Time since the Unix epoch [ns].
    """
    stamp.sec, stamp.nanosec = divmod(nanoseconds, NANOSECONDS)


def set_vector(vector: Any, values: Sequence[float]) -> None:
    """Set x, y and z.

    Parameters
    ----------
    vector : Point or Vector3
        Field to set.
    values : sequence of float
        The three values.
    """
    vector.x, vector.y, vector.z = values


class Floats:
    """A float32[] field, filled from an array without creating Python numbers."""

    def __init__(self, size: int) -> None:
        self.values = array("f", bytes(4 * size))
        self._view = np.frombuffer(self.values, np.float32)

    def fill(self, source: NDArray[np.float32]) -> array[float]:
        """Return the values of `source`."""
        self._view[:] = source
        return self.values
