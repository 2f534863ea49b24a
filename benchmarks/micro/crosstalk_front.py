# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Run time and error of crosstalk compensation: dense, sine transform, neighbours, and non-negative."""

from __future__ import annotations

import numpy as np

from benchmarks.micro.crosstalk_methods import LARGEST_DENSE, NOISE, PITCH, SHARE, SPREAD, by_neighbours, mixing
from benchmarks.outcome import Chart, Outcome, Point, Table
from benchmarks.timing import microseconds
from posfet_model.reconstruction.force_image import non_negative
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Layout

SIZES = (5, 16, 32, 64)


def measure(full: bool) -> Outcome:
    """Compare the methods on random signal maps, and on noisy forces of a fingertip."""
    from reference.dense_pressure import sphere_forces  # noqa: PLC0415  # part of the tests, importable after benchmarks.micro.crosstalk_methods

    repeats = 60 if full else 10
    rows = []
    series: dict[str, list[Point]] = {}
    for size in SIZES:
        layout = Layout(1, size, size, PITCH, PITCH, 1e-6)
        true = np.random.default_rng(0).normal(size=size * size)
        chosen = CrosstalkCompensator(layout, SHARE)
        matrix = mixing(size) if size <= LARGEST_DENSE else None
        sines = CrosstalkCompensator(layout, SHARE)
        sines._dense = None
        mixed = matrix @ true if matrix is not None else _mix(true, size)
        methods = {
            "chosen": lambda chosen=chosen, mixed=mixed: chosen.apply(mixed),
            "sine transform": lambda sines=sines, mixed=mixed: sines.apply(mixed),
            "neighbours, two iterations": lambda mixed=mixed, size=size: by_neighbours(mixed, size),
        }
        if matrix is not None:
            dense = np.linalg.inv(matrix)
            methods["dense"] = lambda dense=dense, mixed=mixed: dense @ mixed
        for name, method in methods.items():
            duration, error = microseconds(method, repeats), float(np.abs(method() - true).max() / np.abs(true).max())
            rows.append((name, f"{size} x {size}", duration, error))
            series.setdefault(name, []).append((duration, max(error, 1e-17), f"{size} x {size}"))
    force = sphere_forces(0.3e-3, -0.2e-3, 1.0, 1.5e-3, 8e6, SPREAD, PITCH, 5)
    inverse = CrosstalkCompensator(Layout(1, 5, 5, PITCH, PITCH, 1e-6), SHARE)
    noisy = inverse.apply(mixing(5) @ force + np.random.default_rng(1).normal(0, NOISE, 25))
    variance = np.full(25, NOISE**2)
    for name, method in (
        ("linear, noisy contact", lambda: noisy),
        ("non-negative, noisy contact", lambda: non_negative(noisy, variance)),
    ):
        rows.append((name, "5 x 5", microseconds(method, repeats), float(np.abs(method() - force).max() / force.max())))
    columns = ("method", "array", "us per scan", "maximum error / maximum value")
    chart = Chart(
        "front_crosstalk", "Compensation of 2 % crosstalk", "run time [us per scan]", "maximum error [1]", series
    )
    return Outcome({"crosstalk_5x5_us": rows[0][2]}, [Table("Crosstalk compensation", columns, rows)], [chart])


def _mix(true: np.ndarray, size: int) -> np.ndarray:
    padded = np.zeros((size + 2, size + 2))
    padded[1:-1, 1:-1] = true.reshape(size, size)
    neighbours = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    return (padded[1:-1, 1:-1] + SHARE * neighbours).reshape(-1)
