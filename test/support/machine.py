# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The elementary functions that this process uses; as a pytest plugin (-p support.machine) it adds them to the header.

NumPy selects its functions by the SIMD level of the processor, libm by the presence of FMA and AVX2. `choice`
distinguishes the selections by the bits of their results.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
from dataclasses import asdict, dataclass

import numpy as np

try:
    from numpy._core import _multiarray_umath as _umath
except ImportError:  # NumPy 1
    from numpy.core import _multiarray_umath as _umath

HEADER = "elementary functions: "

_POINTS = [0.0001 + 0.003 * i for i in range(5000)]


@dataclass(frozen=True)
class Choice:
    """The elementary functions that a process uses."""

    libm: str
    """Digest of results of the math module."""
    numpy: str
    """Digest of results of NumPy's functions."""
    features: list[str]
    """SIMD levels that NumPy uses beyond its build baseline."""


def dispatched() -> list[str]:
    """Return the SIMD levels that NumPy selects from at start, by its own names."""
    return list(_umath.__cpu_dispatch__)


def offers(name: str) -> bool:
    """Return whether NumPy finds the feature on this processor and may use it."""
    return bool(_umath.__cpu_features__.get(name))


def choice() -> Choice:
    """Return the selection of this process, from the bits of a few thousand results."""
    scalar = [f(x) for f in (math.exp, math.sin, math.tanh, math.expm1, math.log1p, math.atan) for x in _POINTS]
    points = np.array(_POINTS)
    arrays = [f(points).tobytes() for f in (np.exp, np.sin, np.tanh, np.expm1, np.log1p, np.arctan)]
    return Choice(
        libm=hashlib.sha256(struct.pack(f"{len(scalar)}d", *scalar)).hexdigest()[:16],
        numpy=hashlib.sha256(b"".join(arrays)).hexdigest()[:16],
        features=[name for name in dispatched() if offers(name)],
    )


def read(report: str) -> Choice:
    """Return the selection that the header of a report states."""
    [line] = [line for line in report.splitlines() if line.startswith(HEADER)]
    return Choice(**json.loads(line.removeprefix(HEADER)))


def pytest_report_header() -> str:
    return HEADER + json.dumps(asdict(choice()))
