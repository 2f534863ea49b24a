# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Crosstalk compensation: run time and error of several methods, by array size.

Inverses of the whole map: a dense matrix, the sine transform (two small matrices on either side), and two iterations
over the neighbours (error (4*share)^3). Non-negative forces: on the taxels of one contact, against exact least squares.

Run: python -m benchmarks.micro.crosstalk_methods
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from posfet_model.reconstruction.force_image import non_negative
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Layout
from reference import crosstalk
from reference.active_set import solve
from reference.dense_pressure import sphere_forces

SHARE = 0.02
NOISE = 0.35e-3
SPREAD, PITCH = 0.6e-3, 1.5e-3
LARGEST_DENSE = 32
REPEATS = 200


def minimum_time(call: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the minimum time of a call [us]."""
    least = np.inf
    for _ in range(repeats):
        begin = time.perf_counter_ns()
        call()
        least = min(least, time.perf_counter_ns() - begin)
    return float(least) * 1e-3


def mixing(size: int) -> np.ndarray:
    """Return the mixing matrix, shape [size^2, size^2]."""
    row = np.eye(size, k=1) + np.eye(size, k=-1)
    return np.eye(size * size) + SHARE * (np.kron(row, np.eye(size)) + np.kron(np.eye(size), row))


def by_neighbours(signal: np.ndarray, size: int) -> np.ndarray:
    """Return the signals without crosstalk, to second order in the share."""
    padded = np.zeros((size + 2, size + 2))
    inner = padded[1:-1, 1:-1]
    measured = signal.reshape(size, size)
    compensated = measured
    for _ in range(2):
        inner[...] = compensated
        neighbours = padded[:-2, 1:-1] + padded[2:, 1:-1]
        neighbours += padded[1:-1, :-2]
        neighbours += padded[1:-1, 2:]
        neighbours *= SHARE
        compensated = measured - neighbours
    return compensated.reshape(-1)


def inverses(size: int) -> None:
    """Print a row of the table of inverses."""
    layout = Layout(1, size, size, PITCH, PITCH, 1e-6)
    true = np.random.default_rng(0).normal(size=size * size)
    matrix = mixing(size)
    mixed = matrix @ true
    chosen = CrosstalkCompensator(layout, SHARE)
    cells = []
    if size <= LARGEST_DENSE:
        dense = np.linalg.inv(matrix)
        cells.append(f"{minimum_time(lambda: dense @ mixed):6.1f} {np.abs(dense @ mixed - true).max():8.0e}")
    else:
        cells.append(f"{'-':>6s} {'-':>8s}")
    sines = crosstalk.CrosstalkCompensator(layout, SHARE)
    sines._dense = None
    cells.append(f"{minimum_time(lambda: sines.apply(mixed)):6.1f} {np.abs(sines.apply(mixed) - true).max():8.0e}")
    rounds = by_neighbours(mixed, size)
    cells.append(f"{minimum_time(lambda: by_neighbours(mixed, size)):6.1f} {np.abs(rounds - true).max():8.0e}")
    cells.append(f"{minimum_time(lambda: chosen.apply(mixed)):6.1f} {np.abs(chosen.apply(mixed) - true).max():8.0e}")
    print(f"{size:3d} x {size:<3d} | " + " | ".join(cells))


def contacts(reach: int) -> None:
    """Print a row of the table of non-negative forces, for a fingertip on (2*reach + 1)^2 taxels."""
    size = 2 * reach + 1
    rng = np.random.default_rng(1)
    force = sphere_forces(0.3e-3, -0.2e-3, 1.0, 1.5e-3, 8e6, SPREAD, PITCH, size)
    matrix, inverse = mixing(size), CrosstalkCompensator(Layout(1, size, size, PITCH, PITCH, 1e-6), SHARE)
    variance = np.full(size * size, NOISE**2)
    errors = np.zeros(3)
    for _ in range(20):
        linear = inverse.apply(matrix @ force + rng.normal(0, NOISE, size * size))
        fast, exact = non_negative(linear, variance), solve(matrix, linear, float(linear.sum()))
        errors += [((estimate - force) ** 2).mean() for estimate in (linear, fast, exact)]
    rms = np.sqrt(errors / 20) * 1e3
    chosen = minimum_time(lambda: non_negative(linear, variance))
    slow = minimum_time(lambda: solve(matrix, linear, float(linear.sum())), 5)
    print(f"{size * size:6d} | {rms[0]:7.3f} | {chosen:6.1f} {rms[1]:7.3f} | {slow:8.0f} {rms[2]:7.3f}")


def main() -> None:
    """Print both tables."""
    print(f"inverse, share {SHARE:.0%}: minimum time [us], maximum error of signals of standard deviation 1")
    print("array     |  dense          |  sine transform |  neighbours     |  chosen")
    for size in (5, 16, 32, 64):
        inverses(size)
    print(f"\nnon-negative, 1 N, noise {NOISE * 1e3:g} mN: minimum time [us], error of a taxel [mN rms]")
    print("taxels | linear | chosen         | exact")
    for reach in (2, 3, 5):
        contacts(reach)


if __name__ == "__main__":
    main()
