# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contact mechanics: orders of the quadrature, and a numerical half-space that knows no shape, for two shapes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front, order
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_model.sensor.description import load_sensor
from posfet_sim.contact.indenters import FlatIndenter, Shape, Sphere
from posfet_sim.contact.quadrature import DiscRule, flat_disc, hertz_disc
from posfet_sim.contact.taxel_forces import Cells, Footprint, points_for

SENSOR = load_sensor()
LAYOUT, SPREAD = SENSOR.layout, SENSOR.device.contact_spread
ORDERS = (2, 4, 6, 8, 12, 16)
FINEST = 40
GRIDS = (12, 24, 48, 96)
FORCE, MODULUS = 2.0, 2e6
CENTRE = (0.4e-3, -0.3e-3)
SHAPES: dict[str, tuple[Shape, Callable[[int], DiscRule]]] = {
    "sphere": (Sphere(5e-3, MODULUS), hertz_disc),
    "flat_indenter": (FlatIndenter(1.6e-3, MODULUS), flat_disc),
}
ROUNDING = 1e-15
"""Rounding of a share of the force [1]."""


def measure(effort: Effort) -> list[Front]:
    """Return a front for each shape."""
    return [_front(name, effort) for name in (["sphere"] if effort.short else SHAPES)]


def _shares(footprint: Footprint, cells: Cells) -> Array:
    """Return the share of the force on each taxel."""
    one = np.ones(1)
    patch = cells.press([[footprint]], CENTRE[0] * one, CENTRE[1] * one, 0 * one, one)
    assert patch is not None
    found = np.zeros((LAYOUT.rows, LAYOUT.cols))
    found[patch.rows, patch.cols] = patch.force[0]
    return found


def _ruled(shape: Shape, rule: Callable[[int], DiscRule], points: int) -> Footprint:
    """Return the shape's footprint with another number of points."""
    (own,) = shape.footprints(FORCE, SPREAD, (0.0, 0.0))
    disc = rule(points)
    return own._replace(u=disc.both, u_weight=disc.x_weight, v=disc.y, v_weight=disc.y_weight)


def _half_space(name: str, half: float, grid: int) -> Array:
    """Return the shares by solving the contact on a grid, then spreading its pressure by the skin."""
    from reference.half_space import axis, press  # noqa: PLC0415  # part of the tests

    x, y = axis(half, grid)[None, :], axis(half, grid)[:, None]
    radius = np.hypot(x, y)
    gap = np.where(radius <= 1.6e-3, 0.0, np.inf) if name == "flat_indenter" else radius**2 / (2 * 5e-3)
    found = press(gap, x, y, FORCE, MODULUS)
    columns = _overlap(LAYOUT.positions[: LAYOUT.cols, 0], found.x.ravel() + CENTRE[0])
    rows = _overlap(LAYOUT.positions[:: LAYOUT.cols, 1], found.y.ravel() + CENTRE[1])
    return np.asarray(rows @ (found.force / FORCE) @ columns.T)


def _overlap(cells: Array, points: Array) -> Array:
    """Return the share of a Gaussian around each point on each cell, shape [cells, points]."""
    erf = np.vectorize(math.erf)
    away, half = cells[:, None] - points, LAYOUT.pitch_x / 2
    return np.asarray(0.5 * (erf((away + half) / SPREAD / math.sqrt(2)) - erf((away - half) / SPREAD / math.sqrt(2))))


def _front(name: str, effort: Effort) -> Front:
    shape, rule = SHAPES[name]
    (own,) = shape.footprints(FORCE, SPREAD, (0.0, 0.0))
    cells = Cells(LAYOUT, SPREAD)
    finest = _shares(_ruled(shape, rule, FINEST), cells)
    shipped = points_for(own.half_length, SPREAD, own.half_length)
    grids = GRIDS[:2] if effort.short else GRIDS
    calls: dict[str, Callable[[], object]] = {}
    errors = {}
    for points in sorted({*ORDERS, shipped}):
        footprint = _ruled(shape, rule, points)
        key = f"quadrature|{points} x {points}"
        errors[key] = float(np.abs(_shares(footprint, cells) - finest).max())
        calls[key] = lambda footprint=footprint: _shares(footprint, cells)
    half = 1.25 * own.half_length
    for grid in grids:
        key = f"numerical half-space|{grid} x {grid}"
        errors[key] = float(np.abs(_half_space(name, half, grid) - finest).max())
        calls[key] = lambda grid=grid: _half_space(name, half, grid)
    seconds = interleaved(calls, min(effort.repeats, 5))
    choices = tuple(Choice(*key.split("|"), error, seconds[key]) for key, error in errors.items())
    by_order = [errors[f"quadrature|{points} x {points}"] for points in (2, 4, 6)]
    by_grid = [errors[f"numerical half-space|{grid} x {grid}"] for grid in grids]
    same = float(np.abs(_shares(own, cells) - _shares(_ruled(shape, rule, shipped), cells)).max())
    checks = (
        Check("order of the half-space towards the quadrature", -order(grids, by_grid), 0.5, 3.0),
        Check("fall of the quadrature's error from 2 to 6 points [1]", by_order[2] / by_order[0], 0.0, 0.05),
        Check("shares of the shipped footprint against those of its number of points [1]", same, 0.0, ROUNDING),
        Check("error of the shipped number of points [share of the force]",
              errors[f"quadrature|{shipped} x {shipped}"], 0.0, 1e-5),
    )  # fmt: skip
    chosen = next(each for each in choices if each.name == f"quadrature, {shipped} x {shipped}")
    best = choices[-1]
    return Front(
        f"mechanics_{name}",
        f"Contact mechanics, {name.replace('_', ' ')}",
        "forces on the taxels of one contact",
        "largest error of a taxel's share of the force [1]",
        f"quadrature with {FINEST} x {FINEST} points of the closed-form pressure, confirmed by the half-space",
        ROUNDING,
        choices,
        chosen.name,
        checks,
        f"{shipped} x {shipped} points are chosen from size and skin; they err by {shown(chosen.error)} of the force. "
        f"The half-space, which assumes no shape, is still {shown(best.error)} off on its finest grid at "
        f"{shown(best.median / chosen.median)} times the run time: choose it only for shapes without a closed form.",
        why_not="A single contact has a fixed cost in which its points do not show; wide contacts and many of them are "
        "why there are no more points than the error of a force needs.",
        question="the forces under a ball" if name == "sphere" else "",
        rival=best.name if name == "sphere" else "",
    )
