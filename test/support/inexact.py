# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""pytest plugin (-p support.inexact): elementary functions with the errors that `sweep.CALL_ULPS` allows.

Each result is changed by up to the allowed error, half of them by all of it. The error depends on the argument alone,
as in any library: the same argument gives the same result. Properties of every library are preserved: exact results
(exp(0) = 1), odd and even functions, and the ranges of sin, cos, tanh, exp and expm1. INEXACT_SEED selects the errors.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any

import numpy as np

from support.sweep import CALL_ULPS

_ODD = {"sin", "tan", "arcsin", "arctan", "sinh", "tanh", "arcsinh", "arctanh", "cbrt"}
_EVEN = {"cos", "cosh", "hypot"}
_RANGE = {"sin": (-1, 1), "cos": (-1, 1), "tanh": (-1, 1), "expm1": (-1, np.inf)}
_NAMES = (
    *("exp", "exp2", "expm1", "log", "log1p", "log2", "log10", "sin", "cos", "tan", "arcsin", "arccos", "arctan"),
    *("arctan2", "sinh", "cosh", "tanh", "arcsinh", "arctanh", "hypot", "cbrt"),
)
_OF_MATH = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "asinh": "arcsinh"}
_OF_MATH |= {"atanh": "arctanh"}
_MATH_NAMES = (*_OF_MATH, "exp", "expm1", "log1p", "log2", "log10", "sin", "cos", "tan", "sinh", "cosh", "tanh", "log")
_SEED = int(os.environ.get("INEXACT_SEED", "0"))


def _share(bits: np.ndarray[Any, Any], salt: int) -> np.ndarray[Any, Any]:
    """Return a number in [-1, 1] from the bits of the argument, half of them at the ends."""
    mixed = bits * np.uint64(0x9E3779B97F4A7C15) + np.uint64(salt)
    mixed ^= mixed >> np.uint64(31)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(29)
    even = (mixed >> np.uint64(11)).astype(np.float64) / 2.0**52 - 1
    return np.clip(2 * even, -1, 1)


class Inexact:
    """An elementary function of NumPy with up to the allowed error."""

    def __init__(self, name: str, exact: Callable[..., Any]) -> None:
        self.name, self.exact = name, exact
        self.salt = sum(map(ord, name)) * 1_000_003 + _SEED * 7919

    def __getattr__(self, name: str) -> Any:
        return getattr(self.exact, name)

    def __call__(self, *arguments: Any, out: Any = None, **options: Any) -> Any:
        result = self.exact(*arguments, **options) if options else self._wrong(*arguments)
        if out is None:
            return result
        out[...] = result
        return out

    def _wrong(self, *arguments: Any) -> Any:
        right = self.exact(*arguments)
        dtype = np.asarray(right).dtype
        with np.errstate(all="ignore"):
            if dtype == np.complex128:
                real, imaginary = (self._moved(part, part.astype(np.longdouble)) for part in (right.real, right.imag))
                return np.where(np.isfinite(right), real + 1j * imaginary, right)[()]
            if dtype.type not in CALL_ULPS:
                return right
            wide = self.exact(*(np.asarray(argument, dtype).astype(np.longdouble) for argument in arguments))
            return self._moved(np.asarray(right), wide, *(np.asarray(argument, dtype) for argument in arguments))

    def _moved(self, right: Any, wide: Any, *arguments: Any) -> Any:
        """Return `wide`, the result in more digits, changed and rounded; arguments or result determine the error."""
        right = np.asarray(right)
        determined_by = np.broadcast_arrays(*(arguments or (right,)))
        mirrored = self.name in _ODD | _EVEN
        bits = sum(((i + 1) * (np.abs(x) if mirrored else x)).astype(np.float64) for i, x in enumerate(determined_by))
        share = _share(np.asarray(bits).view(np.uint64), self.salt)
        if self.name in _ODD:
            share = share * np.where(determined_by[0] < 0, -1, 1)
        most = CALL_ULPS[right.dtype.type] - 0.5  # the rest is the rounding of the sum
        moved = (wide + most * share * np.spacing(np.abs(right)).astype(np.longdouble)).astype(right.dtype)
        kept = ~np.isfinite(right) | (right == 0) | (wide == right)
        moved = np.where(kept, right, moved).astype(right.dtype)
        if not arguments:  # part of a complex result
            return moved
        if self.name == "exp":
            moved = np.where(
                determined_by[0] < 0, np.minimum(moved, 1), np.maximum(moved, np.where(determined_by[0] > 0, 1, 0))
            )
        if self.name in _RANGE:
            moved = np.clip(moved, *_RANGE[self.name])
        return moved.astype(right.dtype)[()]


def _of_math(name: str, exact: Callable[..., Any], inexact: Inexact) -> Callable[..., Any]:
    """Return the function of the math module; it raises the same errors."""

    def function(*arguments: Any) -> Any:
        right = exact(*arguments)
        if not isinstance(right, float) or (name == "log" and len(arguments) > 1):
            return right
        return float(inexact(*(np.float64(argument) for argument in arguments)))

    return function


_FUNCTIONS = {name: Inexact(name, getattr(np, name)) for name in _NAMES}
for _name, _inexact in _FUNCTIONS.items():
    setattr(np, _name, _inexact)
for _name in _MATH_NAMES:
    setattr(math, _name, _of_math(_name, getattr(math, _name), _FUNCTIONS[_OF_MATH.get(_name, _name)]))
