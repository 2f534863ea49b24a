# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charge leakage: integration schemes, steps and float widths, against the closed-form charge of a smooth press."""

from __future__ import annotations

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front, order
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from benchmarks.simulation.runs import SCHEMES, Scheme
from posfet_model._lib.types import Array
from posfet_model.sensor.description import load_sensor

PRESS = 0.1
"""Duration of a raised-cosine press [s]."""

TAXELS = 4096
STEPS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
"""Steps [s]; the board's is that of its scans."""

ORDERS = {
    "first-order hold": 2,
    "trapezoidal rule": 2,
    "zero-order hold": 1,
    "forward Euler": 1,
    "backward Euler": 1,
}
"""Orders of convergence by theory."""

SINGLE = ("first-order hold", "trapezoidal rule")
"""Schemes that are measured in float32, too."""


def measure(effort: Effort) -> list[Front]:
    """Return the front of the schemes."""
    sensor = load_sensor()
    tau, shipped = sensor.device.leak_time_constant, 1.0 / sensor.can.scan_rate
    steps = STEPS[2:] if effort.short else STEPS
    widths = [(name, np.float64) for name in SCHEMES] + [(name, np.float32) for name in SINGLE]
    calls, errors = {}, {}
    for name, dtype in widths:
        for step in steps:
            key = (f"{name}{', float32' if dtype is np.float32 else ''}", f"{step * 1e3:g} ms")
            instants = np.arange(round(PRESS / step) + 1) * step
            found = _march(SCHEMES[name], force(instants).astype(dtype), step / tau)
            errors[key] = 100 * float(np.abs(found - exact(instants, tau)).max())
            rows = min(len(instants) - 1, 30)
            changes = np.full((rows, TAXELS), 1e-3, dtype)
            calls["|".join(key)] = _call(SCHEMES[name], changes, step / tau)
    seconds = interleaved(calls, effort.repeats)
    choices = []
    for key, error in errors.items():
        step = float(key[1].split()[0]) * 1e-3
        rows = min(round(PRESS / step), 30)
        choices.append(Choice(*key, error, tuple(each / (rows * step) for each in seconds["|".join(key)])))
    checks = [
        Check(f"order of {name}", order(steps[:3], [errors[name, f"{step * 1e3:g} ms"] for step in steps[:3]]),
              wanted - 0.25, wanted + 0.25)
        for name, wanted in ORDERS.items()
    ]  # fmt: skip
    theory = 100 * (2 * np.pi / PRESS) ** 2 * steps[0] ** 2 / 24 * (PRESS / np.pi) / tau
    checks.append(Check("error of the first-order hold at the finest step over its bound: what leaks of the chords [1]",
                        errors["first-order hold", f"{steps[0] * 1e3:g} ms"] / theory, 0.1, 1.0))  # fmt: skip
    own = errors["first-order hold", f"{shipped * 1e3:g} ms"]
    other = errors["zero-order hold", f"{shipped * 1e3:g} ms"]
    medians = {(each.series, each.parameter): each.median for each in choices}
    cheaper = medians["zero-order hold", f"{shipped * 1e3:g} ms"] / medians["first-order hold", f"{shipped * 1e3:g} ms"]
    return [
        Front(
            "charge",
            "Charge leakage",
            f"1 s of {TAXELS} taxels",
            "largest error [% of the peak force]",
            "closed form of the charge under a raised cosine of 0.1 s",
            0.0,
            tuple(choices),
            f"first-order hold, {shipped * 1e3:g} ms",
            tuple(checks),
            f"At the scan rate the error of the first-order hold is {shown(own)} %, that of the zero-order hold "
            f"{shown(other / own)} times as much, in {shown(cheaper)} of the run time. Choose the hold by the input, "
            "which is a ramp between scans, and no scheme that is only stable for short steps.",
            why_not={
                "first-order hold, float32": "In float32 the rounding of each step adds up, which its series shows at "
                "short steps; the charge is a small part of a scan's cost, so that the board keeps float64.",
                "": "A longer step costs less in a second; the step is that of the scans.",
            },
            question="the charge of a simulated film",
            rival=f"zero-order hold, {shipped * 1e3:g} ms",
        )
    ]


def force(time: Array) -> Array:
    """Return a press, 1 at its peak."""
    return np.asarray(0.5 * (1 - np.cos(2 * np.pi * time / PRESS)))


def exact(time: Array, tau: float) -> Array:
    """Return the solution of ``s' = f' - s/tau`` from rest."""
    omega = 2 * np.pi / PRESS
    scale = 0.5 * omega * tau / (1 + (omega * tau) ** 2)
    waves = np.sin(omega * time) - omega * tau * np.cos(omega * time)
    return np.asarray(scale * (waves + omega * tau * np.exp(-time / tau)))


def _march(scheme: Scheme, forces: Array, ratio: float) -> Array:
    column = forces[:, None]
    found = [charge.item() for charge in scheme(column, np.diff(column, axis=0), ratio)]
    return np.array([0.0, *found])


def _call(scheme: Scheme, changes: Array, ratio: float):  # type: ignore[no-untyped-def]
    start = np.zeros((1, changes.shape[1]), changes.dtype)

    def run() -> None:
        for _ in scheme(start, changes, ratio):
            pass

    return run
