# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Leakage compensation: none, one pole by two holds, and one pole with the film's relaxation, at several scan rates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_core.scan_path import ForceIntegration
from posfet_model._lib.first_order import mean_decay
from posfet_model._lib.types import Array
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.pole_bank import PoleBank

TAU = load_sensor().device.leak_time_constant
TAXELS = 25
SLOW, SIZES = (0.03, 0.3, 3.0), (0.01, 0.01, 0.01)
"""Relaxation of the film: time constants [s], and sizes relative to the prompt response [1]; assumed."""

DURATION = 2.0
STEPS = (1e-3, 3e-3, 1e-2)
FINE = 16
"""Steps of the simulated film in the smallest step of a scan."""

Compensate = Callable[[Array, float], Array]


def measure(effort: Effort) -> list[Front]:
    """Return a front for a film that only leaks, and one for a film that relaxes."""
    return [_front(relaxing, effort) for relaxing in ((False,) if effort.short else (False, True))]


def press(time: Array) -> Array:
    """Return a force that rises within 0.2 s, is held for 1 s, and falls [N]."""
    return np.asarray(np.interp(time, (0.1, 0.3, 1.3, 1.5), (0.0, 1.0, 1.0, 0.0)))


def signal(step: float, relaxing: bool, fine: int) -> tuple[Array, Array]:
    """Return true forces and the film's signal as a force [N] at the scans, simulated in smaller steps."""
    substeps = round(step / STEPS[0]) * fine
    instants = np.arange(round(DURATION / step) * substeps + 1) * (step / substeps)
    forces = press(instants)
    steps = np.full(len(instants), step / substeps)
    film = forces + (PoleBank(SLOW, SIZES, 1).respond(forces[:, None], steps)[:, 0] if relaxing else 0.0)
    charge = PoleBank((TAU,), (-1.0,), 1).respond(film[:, None], steps)[:, 0] + film
    return forces[::substeps], charge[::substeps]


def none(charge: Array, step: float) -> Array:
    """Return the signal."""
    del step
    return charge


def zero_order(charge: Array, step: float) -> Array:
    """Undo a leak that acts on the charge before each change."""
    out = np.zeros_like(charge)
    for index in range(1, len(charge)):
        out[index] = out[index - 1] + charge[index] * np.exp(step / TAU) - charge[index - 1]
    return out


def one_pole(charge: Array, step: float) -> Array:
    """Undo the leak as this stack does."""
    columns = charge[:, None] if charge.ndim == 1 else charge
    taxels = columns.shape[1]
    integration = ForceIntegration(np.full(taxels, TAU), np.ones(taxels), np.zeros(taxels), np.inf)
    out = np.zeros_like(columns)
    integration.start(columns[0])
    for index in range(1, len(columns)):
        integration.advance(columns[index], step)
        out[index] = integration.raw
    return out.reshape(charge.shape)


def with_relaxation(charge: Array, step: float) -> Array:
    """Undo leak, then relaxation: each slow response follows from the force itself, linear between scans."""
    leaked = one_pole(charge, step)
    ratios = step / np.array(SLOW)
    left, kick, sizes = np.exp(-ratios), mean_decay(ratios), np.array(SIZES)
    columns = leaked[:, None] if leaked.ndim == 1 else leaked
    out, lags = np.zeros_like(columns), np.zeros((len(SLOW), columns.shape[1]))
    whole = 1 + sizes.sum() - sizes @ kick
    for index in range(1, len(columns)):
        # signal = f*(1 + sum a) - sum a*lag, where lag1 = left*lag0 + kick*(f1 - f0)
        carried = left[:, None] * lags - kick[:, None] * out[index - 1]
        out[index] = (columns[index] + sizes @ carried) / whole
        lags = carried + kick[:, None] * out[index]
    return out.reshape(charge.shape)


METHODS: dict[str, Compensate] = {
    "none": none,
    "one pole, zero-order hold": zero_order,
    "one pole": one_pole,
    "one pole and relaxation": with_relaxation,
}


def _front(relaxing: bool, effort: Effort) -> Front:
    calls, errors = {}, {}
    for name, compensate in METHODS.items():
        for step in STEPS:
            forces, charge = signal(step, relaxing, FINE)
            key = f"{name}|{step * 1e3:g} ms"
            errors[key] = 100 * float(np.abs(compensate(charge, step) - forces).max())
            many = np.tile(charge[:60, None], (1, TAXELS))
            calls[key] = lambda compensate=compensate, many=many, step=step: compensate(many, step)
    seconds = interleaved(calls, effort.repeats)
    per_second = {key: 1 / (59 * float(key.split("|")[1].split()[0]) * 1e-3) for key in calls}
    choices = tuple(
        Choice(*key.split("|"), error, tuple(max(each, 1e-9) * per_second[key] for each in seconds[key]))
        for key, error in errors.items()
    )
    finest = f"{STEPS[0] * 1e3:g} ms"
    coarse, fine = (signal(STEPS[0], relaxing, count)[1] for count in (FINE, 2 * FINE))
    uncertainty = 100 * max(float(np.abs(coarse - fine).max()), 1e-13)
    leaked = 100 * max(abs(_held(time)) for time in np.linspace(0.1, 2.0, 191))
    known = "one pole and relaxation" if relaxing else "one pole"
    checks = [
        Check(f"error of {known} at {finest}, but for the film's curvature between two scans [%]",
              errors[f"{known}|{finest}"], 0.0, 1e-4 if relaxing else 1e-8),
    ]  # fmt: skip
    if not relaxing:
        checks.append(Check("error without compensation over the charge that leaks of this press, in closed form [1]",
                            errors[f"none|{finest}"] / leaked, 0.99, 1.01))  # fmt: skip
    own = next(each for each in choices if each.name == f"one pole, {finest}")
    more = next(each for each in choices if each.name == f"one pole and relaxation, {finest}")
    where = "that relaxes" if relaxing else "that only leaks"
    return Front(
        f"compensation_{'relaxing' if relaxing else 'leaking'}",
        f"Leakage compensation, a film {where}",
        f"1 s of {TAXELS} taxels",
        "largest error [% of the peak force]",
        f"the force that was simulated in {FINE} steps a millisecond",
        uncertainty,
        choices,
        own.name,
        tuple(checks),
        f"On a film {where} one pole errs by {shown(own.error)} %, with the film's relaxation by {shown(more.error)} "
        f"%, at {shown(more.median / own.median)} times the run time. The inverse with several poles exists in this "
        "benchmark alone: in the stack the slow responses are states of the estimator, as their sizes "
        "are not known well enough to be inverted.",
        why_not={
            "one pole and relaxation": "It is told the sizes of the relaxation, which no sensor comes with: the stack "
            "estimates them instead.",
            "": "A longer step costs less in a second and errs no more on this slow press; the step is that of the "
            "scans, and taps need it short.",
        },
        question="" if relaxing else "the force that is held while its charge leaks",
        rival="" if relaxing else f"none, {finest}",
    )


def _held(time: float) -> float:
    """Return the true error without compensation: the charge of three ramps, minus the force [1]."""
    total = 0.0
    for corner, slope in ((0.1, 5.0), (0.3, -5.0), (1.3, -5.0), (1.5, 5.0)):
        if time > corner:
            total += slope * TAU * -np.expm1(-(time - corner) / TAU)
    return float(total - press(np.array(time)))
