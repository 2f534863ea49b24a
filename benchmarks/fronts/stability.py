# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Stability: error against step over time constant, up to where explicit schemes diverge, and after many steps."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from benchmarks.fronts.exhibit import Exhibit
from benchmarks.fronts.front import Check, Effort, order
from benchmarks.fronts.palette import Palette
from benchmarks.outcome import Cell, shown
from posfet_model._lib.types import Array
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.figures import style
from posfet_model.figures.schemes import SCHEMES, largest_error

RATIOS = np.logspace(-4, 4, 97)
"""Step over time constant [1]."""

ORDERS = {"Euler": 1, "Heun": 2, "Runge-Kutta 4": 4, "trapezoidal": 2, "backward Euler": 1}
LIMITS = {"Euler": 2.0, "Heun": 2.0, "Runge-Kutta 4": 2.785}
"""Step over time constant from which a scheme diverges, by theory [1]."""

TAUS = (1e-6, 1e-3, 1.0, 1e4)
STEPS = (1e-9, 1e-6, 1e-3, 1.0, 1e3)
"""Corners: time constants and steps [s]."""

CORNER_STEPS = 400
LEAST, MOST = 1e-17, 1e3
"""Range of errors that is drawn [V]."""

MANY = 2_000_000
"""Steps of the short version of `make stability`, which takes 1e8."""


def measure(effort: Effort) -> list[Exhibit]:
    """Return the exhibit."""
    from support import drift  # noqa: PLC0415  # part of the tests; its reference needs mpmath

    errors = {scheme.name: largest_error(scheme, RATIOS) for scheme in SCHEMES}
    errors["exact exponential"] = np.array([_own(float(ratio)) for ratio in RATIOS])
    corner = max(_corner(tau, step) for tau in TAUS for step in STEPS)
    steps = MANY // 100 if effort.short else MANY
    runs = {case.name: case.run(steps) for case in drift.cases() if "SquareLaw" not in case.name}
    share = {name: found.largest / found.bound for name, found in runs.items()}
    rows: list[tuple[Cell, ...]] = []
    for name, error in errors.items():
        rows.append((name, *_of_line(error), _first(error > 1e6)))
    fine = RATIOS < 0.1
    checks = [
        *(Check(f"order of {name}", _order(errors[name], fine), wanted - 0.15, wanted + 0.15)
          for name, wanted in ORDERS.items()),
        *(Check(f"step over time constant from which {name} diverges, over theory [1]",
                float(RATIOS[errors[name] > 1e6][0]) / limit, 1.0, 1.35) for name, limit in LIMITS.items()),
        Check("largest error of the exact exponential [V]", float(errors["exact exponential"].max()), 0.0, 1e-14),
        Check("largest error at the corners, tau 1 us to 1e4 s, steps 1 ns to 1000 s [V]", corner, 0.0, 1e-12),
        Check(f"largest error after {steps:.0e} steps over its bound [1]", max(share.values()), 0.0, 1.0),
    ]  # fmt: skip
    worst = max(share, key=share.__getitem__)
    return [
        Exhibit(
            "front_stability",
            "Stability",
            "The exponential scheme of this stack has no limit: explicit schemes diverge where their line leaves the "
            "figure, implicit ones stay finite and wrong, and this one is within "
            f"{shown(corner)} V of 1 V at every corner of time constants from 1 us to 1e4 s and steps from 1 ns to "
            f"1000 s, and after {steps:.0e} steps within {shown(max(share.values()))} of the bound that rounding "
            f"allows (largest of {len(runs)} runs: {worst}). Choose the step by the signal alone; `make stability` "
            "takes 1e8 steps, docs/stability.md has the map.",
            ("scheme", "error at a tenth of the time constant V", "above 1 mV from step/tau", "diverges from step/tau"),
            rows,
            lambda palette: _draw(errors, palette),
            tuple(checks),
            _read_back,
            (
                "a time step of simulated film and amplifier",
                "any, exact exponential",
                f"{shown(max(float(errors['exact exponential'].max()), LEAST))} V of 1 V",
                "Runge-Kutta 4",
                "not measured",
                f"diverges from {shown(_first(errors['Runge-Kutta 4'] > 1e6))} time constants on",
            ),
        )
    ]


def _order(error: Array, fine: Array) -> float:
    """Return the order over fine steps whose runs are longer than the time constant, and errors above rounding."""
    used = fine & (RATIOS > 1e-2) & (error > 1e-12)
    return order(RATIOS[used].tolist(), error[used].tolist())


def _own(ratio: float) -> float:
    """Return the largest error of this stack's follower on the same test: 200 steps after a jump of 1 V [V]."""
    follower = OnePoleFollower(gain=1.0, bandwidth=1 / (2 * np.pi))
    state = follower.start(0.0)
    state = follower.advance(state, 1.0, 0.0)
    worst = 0.0
    for count in range(1, 201):
        state = follower.advance(state, 1.0, ratio)
        exact = -np.expm1(-np.longdouble(count) * np.longdouble(ratio))
        worst = max(worst, abs(float(follower.output(state).v_out) - float(exact)))
    return worst


def _corner(tau: float, step: float) -> float:
    """Return the error at the end of many steps of a ramp of 1 V [V]."""
    follower = OnePoleFollower(gain=1.0, bandwidth=1 / (2 * np.pi * tau))
    instants = np.arange(CORNER_STEPS + 1) * step
    found = follower.run(instants, np.linspace(0.0, 1.0, CORNER_STEPS + 1)).v_out
    slope = np.longdouble(1.0) / (CORNER_STEPS * np.longdouble(step))
    time = np.arange(CORNER_STEPS + 1, dtype=np.longdouble) * np.longdouble(step)
    tau_ = np.longdouble(1 / (2 * np.pi * follower.bandwidth))
    exact = slope * (time + tau_ * np.expm1(-time / tau_))
    return float(np.abs(found - exact).max())


def _first(where: Array) -> float | str:
    """Return the first step over time constant at which a mask is true."""
    return float(RATIOS[where][0]) if where.any() else "never"


def _of_line(error: Array) -> tuple[float, float | str]:
    """Return the error at a tenth of the time constant [V], and from which ratio it is above 1 mV."""
    return max(float(error[np.abs(RATIOS - 0.1).argmin()]), LEAST), _first(error > 1e-3)


def _read_back(figure: Figure) -> list[tuple[Cell, ...]]:
    """Return the first columns of the table from the lines of a figure; a line that left it diverged."""
    lines = [line for axes in figure.axes for line in axes.get_lines() if str(line.get_gid()).startswith("series ")]
    found = []
    for line in lines:
        error = np.nan_to_num(np.asarray(line.get_ydata(), float), nan=np.inf)
        found.append((str(line.get_label()), *_of_line(error)))
    return found


def _draw(errors: dict[str, Array], palette: Palette) -> Figure:
    figure, (axes,) = style.new_figure(4.2)
    for (name, error), (colour, marker) in zip(errors.items(), palette.looks, strict=False):
        shown_part = np.where(error > MOST, np.nan, np.maximum(error, LEAST))
        axes.loglog(
            RATIOS, shown_part, color=colour, marker=marker, markevery=8, markersize=5, label=name, linewidth=1.4,
            gid=f"series {name}",
        )  # fmt: skip
    axes.axvspan(2.0, RATIOS[-1], color=palette.shade, zorder=0)
    style.label(axes, 60.0, 1e-8, "explicit schemes\ndiverge from here on", palette.ink, ha="center", bbox=None)
    axes.set(xlabel="step over time constant [1]", ylabel="largest error in 200 steps [V]", ylim=(LEAST / 3, MOST))
    axes.set_title("A jump of 1 V, one pole")
    figure.legend(loc="outside lower center", ncols=4, fontsize=7.5, frameon=False, handlelength=2.6)
    return figure
