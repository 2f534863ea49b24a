# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Film hysteresis: closed form against integration of a loop, and minor loops against a finite number of operators."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from benchmarks.fronts.front import Check, Effort, Front, order
from benchmarks.fronts.interleaved import timed
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_model.device.film import Film, polarise, saturated
from posfet_sim.device.play_operators import play_outputs

FILM = Film(160e5, 0.02, 0.05, 12.0)
"""The film of the documents: coercive field, remnant and saturation polarisation, permittivity."""

STEPS = (16, 32, 64, 128, 256)
PLAYS = (2, 4, 8, 16, 32, 64, 128)
SAMPLES = 400
FLOAT64 = 1e-14
"""Rounding after a few hundred steps [1]."""


def measure(effort: Effort) -> list[Front]:
    """Return the fronts of a branch and of minor loops."""
    return [_branch(effort), _minor_loops(effort)]


def _slope(field: Array | float) -> Array:
    """Return dP/dE of the rising branch, from its definition Ps*tanh((E - Ec)/(2*delta))."""
    width = 2 * FILM.steepness
    return np.asarray(FILM.saturation_polarisation / width / np.cosh((field - FILM.coercive_field) / width) ** 2)


def _euler(start: float, fields: Array) -> float:
    polarisation = start
    for before, after in pairwise(fields.tolist()):
        polarisation += (after - before) * float(_slope(before))
    return polarisation


def _midpoint(start: float, fields: Array) -> float:
    polarisation = start
    for before, after in pairwise(fields.tolist()):
        polarisation += (after - before) * float(_slope(0.5 * (before + after)))
    return polarisation


def _branch(effort: Effort) -> Front:
    """Rise from negative remanence to three times the coercive field."""
    top, start = 3 * FILM.coercive_field, saturated(FILM, positive=False)
    linear = float(polarise([0.0, top], FILM, start).polarisation[1])
    width = np.longdouble(2 * FILM.steepness)
    high = np.tanh((np.longdouble(top) - np.longdouble(FILM.coercive_field)) / width)
    exact = float(np.longdouble(FILM.saturation_polarisation) * high)
    permittivity = FILM.relative_permittivity * 8.8541878128e-12 * top
    scale = FILM.saturation_polarisation
    methods = {("closed form", ""): (lambda: polarise([top], FILM, start), abs(linear - permittivity - exact) / scale)}
    for steps in STEPS[:3] if effort.short else STEPS:
        fields = np.linspace(0.0, top, steps + 1)
        begin = -FILM.remnant_polarisation
        for name, method in (("Euler", _euler), ("midpoint rule", _midpoint)):
            error = abs(method(begin, fields) - exact) / scale
            methods[name, f"{steps} steps"] = (partial(method, begin, fields), error)
    choices = timed(methods, effort.repeats)
    fits = {
        name: -order([int(each.parameter.split()[0]) for each in choices if each.series == name],
                     [each.error for each in choices if each.series == name])
        for name in ("Euler", "midpoint rule")
    }  # fmt: skip
    checks = (
        Check("order of Euler", fits["Euler"], 0.8, 1.2),
        Check("order of the midpoint rule", fits["midpoint rule"], 1.8, 2.2),
        Check("error of the closed form [saturation polarisation]", choices[0].error, 0.0, 1e-9),
    )
    best = min(choices[1:], key=lambda each: each.error)
    return Front(
        "hysteresis_branch",
        "Film hysteresis, one branch",
        "one rise of the field from remanence to three times the coercive field",
        "error of the polarisation [saturation polarisation]",
        "the branch in 80-bit floating point",
        1e-10,
        choices,
        "closed form",
        checks,
        f"The closed form goes to any field in one step; the midpoint rule with {best.parameter} is "
        f"{shown(best.error)} of saturation off and takes {shown(best.median / choices[0].median)} times as long. "
        "Choose the closed form, and store turning points, not samples.",
        why_not="A call of the closed form checks its arguments, which a few coarse steps here do not.",
        question="the polarisation of a film",
        rival=best.name,
    )


def _everett(forces: Array) -> Array:
    """Return a uniform density of play operators exactly, from the turning points of the force.

    From rest a rise f leaves f^2/2; a reversal by d changes that by d^2/4. A turning point that is passed again is
    forgotten (Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, section 2.6).
    """
    turns, found = [0.0], np.empty(len(forces))
    for index, force in enumerate(forces.tolist()):
        while len(turns) > 2 and abs(force - turns[-1]) >= abs(turns[-1] - turns[-2]):
            del turns[-2:]
        if len(turns) == 2 and abs(force) >= abs(turns[1]):
            del turns[1:]
        after = forces[index + 1] if index + 1 < len(forces) else force
        path = [*turns, force]
        sign = np.sign(path[1] - path[0])
        total = sign * path[1] ** 2 / 2
        for before, now in pairwise(path[1:]):
            total += np.sign(now - before) * (now - before) ** 2 / 4
        found[index] = total
        if (after - force) * (force - turns[-1]) < 0:
            turns.append(force)
    return found


def _minor_loops(effort: Effort) -> Front:
    """Follow a decaying oscillation of the force with plays of evenly spaced half-widths."""
    time = np.linspace(0, 1, SAMPLES)
    forces = np.exp(-2 * time) * np.sin(2 * np.pi * 5 * time)
    exact = _everett(forces)
    scale = float(np.ptp(exact))
    methods = {}
    for count in PLAYS[:4] if effort.short else PLAYS:
        widths = ((np.arange(count) + 0.5) / count)[:, None]

        def follow(widths: Array = widths, count: int = count) -> Array:
            return np.asarray(play_outputs(forces[:, None], np.zeros((count, 1)), widths)[:, :, 0].mean(axis=1))

        error = float(np.abs(follow() - exact).max()) / scale
        methods["play operators", f"{count}"] = (follow, error)
    methods["turning points", ""] = (lambda: _everett(forces), 0.0)
    choices = timed(methods, effort.repeats)
    plays = [each for each in choices if each.series == "play operators"]
    fit = -order([int(each.parameter) for each in plays], [each.error for each in plays])
    last = choices[-1]
    fine = plays[-1]
    return Front(
        "hysteresis_minor_loops",
        "Film hysteresis, minor loops",
        f"{SAMPLES} samples of one taxel",
        "largest error [peak to peak]",
        "uniform density of play operators, in closed form from the turning points",
        FLOAT64,
        choices,
        "",
        (Check("order of convergence in the number of operators", fit, 1.6, 2.4),),
        f"{fine.parameter} operators are {shown(fine.error)} of the loop off, in {shown(fine.median / last.median)} of "
        "the run time of the turning points: choose operators for arrays, where all taxels advance at once, and "
        "turning points for the history of one film. The simulated board has a few operators of given widths: that "
        "is its definition of the film, not an approximation.",
    )
