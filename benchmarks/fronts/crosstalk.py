# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Crosstalk compensation: neighbour iterations of several orders, dense inverse, sine transform; two sizes of array."""

from __future__ import annotations

import itertools

import numpy as np

from benchmarks.fronts.front import Check, Effort, Front
from benchmarks.fronts.interleaved import timed
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Layout
from reference import crosstalk

SHARE = 0.02
SIZES = (5, 32)
ORDERS = (1, 2, 3, 4, 6)
FLOAT64 = 1e-15
"""Rounding of a sum over an array [1]."""


def measure(effort: Effort) -> list[Front]:
    """Return a front for each size."""
    return [_front(size, effort) for size in (SIZES[:1] if effort.short else SIZES)]


def by_neighbours(signal: Array, size: int, iterations: int) -> Array:
    """Return the signals without crosstalk by Jacobi's iteration; 0 iterations: unchanged."""
    padded = np.zeros((size + 2, size + 2))
    inner = padded[1:-1, 1:-1]
    measured = signal.reshape(size, size)
    compensated = measured
    for _ in range(iterations):
        inner[...] = compensated
        neighbours = padded[:-2, 1:-1] + padded[2:, 1:-1]
        neighbours += padded[1:-1, :-2]
        neighbours += padded[1:-1, 2:]
        neighbours *= SHARE
        compensated = measured - neighbours
    return compensated.reshape(-1)


def _front(size: int, effort: Effort) -> Front:
    true = np.random.default_rng(0).normal(size=size * size)
    row = np.eye(size, k=1) + np.eye(size, k=-1)
    matrix = np.eye(size * size) + SHARE * (np.kron(row, np.eye(size)) + np.kron(np.eye(size), row))
    mixed, dense = matrix @ true, np.linalg.inv(matrix)
    layout = Layout(1, size, size, 1.5e-3, 1.5e-3, 1e-6)
    chosen, sines = CrosstalkCompensator(layout, SHARE), crosstalk.CrosstalkCompensator(layout, SHARE)
    sines._dense = None
    methods = {
        ("none", ""): lambda: mixed,
        **{
            ("neighbours", f"{count} iterations"): (lambda count=count: by_neighbours(mixed, size, count))
            for count in ORDERS
        },
        ("dense inverse", ""): lambda: dense @ mixed,
        ("sine transform", ""): lambda: sines.apply(mixed),
        ("this stack", "sine transform, compiled"): lambda: chosen.apply(mixed),
    }
    scale = float(np.abs(true).max())
    errors = {key: float(np.abs(method() - true).max()) / scale for key, method in methods.items()}
    choices = timed({key: (method, errors[key]) for key, method in methods.items()}, effort.repeats)
    falls = [errors["neighbours", f"{after} iterations"] / errors["neighbours", f"{before} iterations"]
             for before, after in itertools.pairwise(ORDERS) if after == before + 1]  # fmt: skip
    exact = {key[0]: error for key, error in errors.items() if key[0] in ("dense inverse", "sine transform")}
    checks = (
        Check(
            "fall of the error by one more iteration, over four times the share [1]", max(falls) / (4 * SHARE), 0.2, 1.0
        ),
        *(Check(f"error of {name} [1]", error, 0.0, FLOAT64 * 10) for name, error in exact.items()),
    )
    shipped = "this stack, sine transform, compiled"
    second = next(each for each in choices if each.name == "neighbours, 2 iterations")
    own = next(each for each in choices if each.name == shipped)
    return Front(
        f"crosstalk_{size}x{size}",
        f"Crosstalk compensation, {size} x {size}",
        f"one scan of {size} x {size} taxels with {SHARE * 100:g} % of crosstalk",
        "largest error [largest signal]",
        "signals before the crosstalk was added",
        FLOAT64,
        choices,
        shipped,
        checks,
        f"The exact inverse costs {shown(own.median / second.median)} of the run time of two rounds over the "
        f"neighbours, which leave {shown(second.error)} of the largest signal. It needs no library for matrices.",
        why_not="It is a part of the compiled path, which can be called without Python; NumPy's library for matrices "
        "has vector instructions, which pay on large arrays.",
        question=f"crosstalk at {size} x {size}",
        rival=second.name,
    )
