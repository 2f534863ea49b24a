"""Crosstalk undone: dense, by sines, by neighbours, and not below zero; time and error side by side."""

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
    """Compare the ways on maps of random signals, and with noise on the forces of a fingertip."""
    from reference.dense_pressure import sphere_forces  # noqa: PLC0415  # of the tests; benchmarks.micro.crosstalk_methods has found them

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
        shown = matrix @ true if matrix is not None else _mix(true, size)
        ways = {
            "chosen": lambda chosen=chosen, shown=shown: chosen.apply(shown),
            "sines": lambda sines=sines, shown=shown: sines.apply(shown),
            "neighbours, two rounds": lambda shown=shown, size=size: by_neighbours(shown, size),
        }
        if matrix is not None:
            dense = np.linalg.inv(matrix)
            ways["dense"] = lambda dense=dense, shown=shown: dense @ shown
        for name, way in ways.items():
            taken, error = microseconds(way, repeats), float(np.abs(way() - true).max() / np.abs(true).max())
            rows.append((name, f"{size} x {size}", taken, error))
            series.setdefault(name, []).append((taken, max(error, 1e-17), f"{size} x {size}"))
    force = sphere_forces(0.3e-3, -0.2e-3, 1.0, 1.5e-3, 8e6, SPREAD, PITCH, 5)
    inverse = CrosstalkCompensator(Layout(1, 5, 5, PITCH, PITCH, 1e-6), SHARE)
    noisy = inverse.apply(mixing(5) @ force + np.random.default_rng(1).normal(0, NOISE, 25))
    variance = np.full(25, NOISE**2)
    for name, way in (
        ("linear, noisy contact", lambda: noisy),
        ("not below zero, noisy contact", lambda: non_negative(noisy, variance)),
    ):
        rows.append((name, "5 x 5", microseconds(way, repeats), float(np.abs(way() - force).max() / force.max())))
    columns = ("way", "array", "us a scan", "largest error / greatest")
    chart = Chart("front_crosstalk", "Crosstalk of 2 % undone", "run time [us a scan]", "largest error [1]", series)
    return Outcome({"crosstalk_5x5_us": rows[0][2]}, [Table("Crosstalk", columns, rows)], [chart])


def _mix(true: np.ndarray, size: int) -> np.ndarray:
    padded = np.zeros((size + 2, size + 2))
    padded[1:-1, 1:-1] = true.reshape(size, size)
    beside = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    return (padded[1:-1, 1:-1] + SHARE * beside).reshape(-1)
