"""Crosstalk undone: time and error of the ways there are, by the size of the array.

Inverses of the whole map: a dense matrix, the sine transform (two small matrices on either side), and two rounds over
the neighbours (error (4*share)^3). Forces not below zero: on the taxels of one contact, against exact least squares.

Run: python -m benchmarks.micro.crosstalk_methods
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from posfet_model.reconstruction.force_image import non_negative
from posfet_model.sensor.crosstalk import DENSE, CrosstalkCompensator
from posfet_model.sensor.description import Layout
from reference.active_set import solve
from reference.dense_pressure import sphere_forces

SHARE = 0.02
NOISE = 0.35e-3
SPREAD, PITCH = 0.6e-3, 1.5e-3
LARGEST_DENSE = 32
REPEATS = 200


def least_time(call: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the least time of a call [us]."""
    least = np.inf
    for _ in range(repeats):
        begin = time.perf_counter_ns()
        call()
        least = min(least, time.perf_counter_ns() - begin)
    return float(least) * 1e-3


def mixing(size: int) -> np.ndarray:
    """Return what each taxel shows of all, shape [size^2, size^2]."""
    row = np.eye(size, k=1) + np.eye(size, k=-1)
    return np.eye(size * size) + SHARE * (np.kron(row, np.eye(size)) + np.kron(np.eye(size), row))


def by_neighbours(signal: np.ndarray, size: int) -> np.ndarray:
    """Return the signals without crosstalk to the second order of the share."""
    padded = np.zeros((size + 2, size + 2))
    inner = padded[1:-1, 1:-1]
    given = signal.reshape(size, size)
    undone = given
    for _ in range(2):
        inner[...] = undone
        beside = padded[:-2, 1:-1] + padded[2:, 1:-1]
        beside += padded[1:-1, :-2]
        beside += padded[1:-1, 2:]
        beside *= SHARE
        undone = given - beside
    return undone.reshape(-1)


def inverses(size: int) -> None:
    """Print a row of the table of inverses."""
    layout = Layout(1, size, size, PITCH, PITCH, 1e-6)
    true = np.random.default_rng(0).normal(size=size * size)
    matrix = mixing(size)
    shown = matrix @ true
    chosen = CrosstalkCompensator(layout, SHARE)
    cells = []
    if size <= LARGEST_DENSE:
        dense = np.linalg.inv(matrix)
        cells.append(f"{least_time(lambda: dense @ shown):6.1f} {np.abs(dense @ shown - true).max():8.0e}")
    else:
        cells.append(f"{'-':>6s} {'-':>8s}")
    sines = CrosstalkCompensator(layout, SHARE)
    sines._dense = None
    cells.append(f"{least_time(lambda: sines.apply(shown)):6.1f} {np.abs(sines.apply(shown) - true).max():8.0e}")
    rounds = by_neighbours(shown, size)
    cells.append(f"{least_time(lambda: by_neighbours(shown, size)):6.1f} {np.abs(rounds - true).max():8.0e}")
    cells.append(f"{least_time(lambda: chosen.apply(shown)):6.1f} {'dense' if size * size <= DENSE else 'sines':>8s}")
    print(f"{size:3d} x {size:<3d} | " + " | ".join(cells))


def contacts(reach: int) -> None:
    """Print a row of the table of forces not below zero, for a fingertip on (2*reach + 1)^2 taxels."""
    size = 2 * reach + 1
    rng = np.random.default_rng(1)
    force = sphere_forces(0.3e-3, -0.2e-3, 1.0, 1.5e-3, 8e6, SPREAD, PITCH, size)
    matrix, inverse = mixing(size), CrosstalkCompensator(Layout(1, size, size, PITCH, PITCH, 1e-6), SHARE)
    variance = np.full(size * size, NOISE**2)
    errors = np.zeros(3)
    for _ in range(20):
        linear = inverse.apply(matrix @ force + rng.normal(0, NOISE, size * size))
        fast, exact = non_negative(linear, variance), solve(matrix, linear, float(linear.sum()))
        errors += [((guess - force) ** 2).mean() for guess in (linear, fast, exact)]
    rms = np.sqrt(errors / 20) * 1e3
    chosen = least_time(lambda: non_negative(linear, variance))
    slow = least_time(lambda: solve(matrix, linear, float(linear.sum())), 5)
    print(f"{size * size:6d} | {rms[0]:7.3f} | {chosen:6.1f} {rms[1]:7.3f} | {slow:8.0f} {rms[2]:7.3f}")


def main() -> None:
    """Print both tables."""
    print(f"inverse, share {SHARE:.0%}: least time [us], greatest error of signals of deviation 1")
    print("array     |  dense          |  sines          |  neighbours     |  chosen")
    for size in (5, 16, 32, 64):
        inverses(size)
    print(f"\nnot below zero, 1 N, noise {NOISE * 1e3:g} mN: least time [us], error of a taxel [mN rms]")
    print("taxels | as it is | chosen         | exact")
    for reach in (2, 3, 5):
        contacts(reach)


if __name__ == "__main__":
    main()
