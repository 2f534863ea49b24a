# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Helpers of the device model tests: corners, strategies, reference tables, rejected arguments, error maps."""

from __future__ import annotations

import csv
import inspect
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from support.each_row import each_row

EPS = float(np.finfo(np.float64).eps)
"""One unit in the last place of 1 [1]; a rounding is half of it."""

CALL_ULPS = {np.float64: 2, np.float32: 4}
"""Largest error of one call of an elementary function (exp, log, sin, tanh, ...) on any x86-64 [units in last place].

Sums, products, quotients and square roots are identical everywhere (IEEE 754), elementary functions are not: NumPy and
libm have several variants and select by processor. float64: NumPy's own accuracy tests allow 1 unit, 2 for tanh
(numpy/_core/tests/data/umath-validation-set-*.csv), the manual of glibc states at most 2 on x86-64 (section "Known
Maximum Errors in Math Functions"); measured against mpmath with every choice of SIMD level: 1.97, of libm's tanh.
float32: NumPy's tests allow 4; measured: 2.93, of log.

Bounds are sums of these: `call_error` times the condition of the result, and half an EPS for each other rounding.
"""

DATA = Path(__file__).resolve().parents[1] / "data" / "device"

NOT_REAL_NUMBERS: tuple[Any, ...] = (math.nan, math.inf, -math.inf, 1 + 1j, "one", None, True)
"""Values that every real argument of the model rejects."""


def call_error(dtype: Any = np.float64) -> float:
    """Return the largest relative error of one call of an elementary function, see `CALL_ULPS`."""
    return CALL_ULPS[dtype] * float(np.finfo(dtype).eps)


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    """Return positive floats, uniformly distributed over the decades between `low` and `high`, both ends included."""

    def power(exponent: float) -> float:
        return min(max(10.0**exponent, low), high)

    return st.one_of(st.sampled_from((low, high)), st.floats(math.log10(low), math.log10(high)).map(power))


def signed_decades(low: float, high: float) -> st.SearchStrategy[float]:
    """Return zero and floats of both signs with magnitudes as in `decades`."""
    return st.one_of(st.just(0.0), decades(low, high), decades(low, high).map(lambda value: -value))


def corners(**values: Sequence[float]) -> dict[str, np.ndarray[Any, Any]]:
    """Return every combination of the given values, one flat float64 array per argument."""
    grid = np.array(list(itertools.product(*values.values())), dtype=np.float64).reshape(-1, len(values))
    return {name: grid[:, column].copy() for column, name in enumerate(values)}


def reference(name: str) -> dict[str, np.ndarray[Any, Any]]:
    """Return the columns of test/data/device/NAME.csv, each 40-digit number rounded once to float64."""
    with (DATA / f"{name}.csv").open(newline="", encoding="ascii") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    columns = np.array([[float(cell) for cell in row] for row in rows[1:]]).T
    return dict(zip(rows[0], columns, strict=True))


Refusal = tuple[str, Mapping[str, Any]]
"""The argument that a call must reject, and all arguments of the call."""


def refusals(function: Callable[..., Any], good: Mapping[str, Any], **outside: Sequence[Any]) -> Any:
    """Return one pytest parameter (function, cases) with every value that an argument must reject.

    `outside` gives the values out of range; values that are no real number are added for each argument in it. Every
    argument of the function without a default must be in `good`, so that none is forgotten.
    """
    required = {p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty}
    assert required <= set(good), f"{function.__name__}: no good value of {required - set(good)}"
    cases = [(name, {**good, name: value}) for name in outside for value in (*outside[name], *NOT_REAL_NUMBERS)]
    return pytest.param(function, cases, id=function.__qualname__)


def assert_refused(function: Callable[..., Any], arguments: Mapping[str, Any], name: str) -> None:
    """Assert that the call raises ValueError with a message that names the argument."""
    with pytest.raises(ValueError, match=rf"\b{name}\b"):
        function(**arguments)


def assert_all_refused(function: Callable[..., Any], cases: Sequence[Refusal]) -> None:
    """Assert `assert_refused` for every call; failures are reported together."""
    with each_row() as row:
        for name, arguments in cases:
            with row(f"{function.__qualname__}, {name} = {arguments[name]!r:.60}"):
                assert_refused(function, arguments, name)


def assert_finite(value: Any) -> None:
    """Assert that every element is a finite number."""
    assert np.isfinite(np.asarray(value)).all()


def assert_monotone(values: Any, *, rising: bool, slack: Any = 0.0) -> None:
    """Assert that the last axis is monotonic up to `slack`, the stated rounding."""
    steps = np.diff(np.asarray(values), axis=-1)
    assert ((steps if rising else -steps) >= -np.asarray(slack)).all()


class ErrorMap:
    """The largest error in each region of a sweep, and the bound of the whole sweep."""

    def __init__(self, bound: float) -> None:
        self.bound = bound
        self.worst: dict[str, float] = {}

    def add(self, region: str, error: Any) -> None:
        """Add the largest of `error` to the region; NaN counts as infinite."""
        largest = float(np.max(np.nan_to_num(np.abs(error), nan=math.inf), initial=0.0))
        self.worst[region] = max(largest, self.worst.get(region, 0.0))

    def check(self, record_property: Callable[[str, object], None]) -> None:
        """Record the error per region with the test, then assert the bound."""
        for region, error in self.worst.items():
            record_property(region, f"{error:.2e}")
            print(f"{region}: {error:.2e} (bound {self.bound:.0e})")
        assert self.worst
        assert max(self.worst.values()) <= self.bound, self.worst
