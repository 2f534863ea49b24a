# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Range of inputs at which an op-amp circuit works as a follower at rest: saturated, and stable.

A load resistor takes the current from M7 at low inputs: with two stages the second pole falls with it, and the follower
oscillates before a transistor leaves saturation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_topology import UNKNOWNS
from posfet_model.amplifier.operating_point import MIN_OUTPUT_CURRENT

_SATURATION_HALVINGS: Final = 13
_STABILITY_HALVINGS: Final = 8
_LAST_CHANGE: Final = 1e-4  # of an operating point, of the supply
_GRID: Final = np.arange(1, 5) / 4
"""Shares of the saturated range at which stability is tested, from 0 V outwards."""


@dataclass(frozen=True, eq=False)
class InputRange:
    """Ends of the range that contains 0 V [V], of the circuits' shape; NaN where 0 V itself is not in it."""

    lowest_saturated: Array
    """Lowest input with all transistors saturated, and M7 with its minimum current."""
    highest_saturated: Array
    """The same for the highest input."""
    lowest: Array
    """Lowest input at which the follower is stable, too."""
    highest: Array
    """The same for the highest input."""


def input_range(circuit: AmplifierCircuit, nodes: Array) -> InputRange:
    """Return the range of inputs of op-amp circuits as followers.

    Saturation is lost by bisection from 0 V; stability on a grid of that range, and by bisection behind the last point
    up to which the follower is stable.

    Parameters
    ----------
    circuit : AmplifierCircuit
        Circuits of the shape [n].
    nodes : ndarray
        Their operating points at 0 V [V], shape [n, nodes].

    Returns
    -------
    InputRange
        Ends of the range, a thousandth of it too near to 0 V at most.
    """
    zero = np.zeros(circuit.shape)
    usable, quiet = _saturated(circuit, nodes, zero), circuit.stable(nodes, zero)
    ends, stable_ends = [], []
    for sign in (-1, 1):
        outside = sign * np.broadcast_to(circuit.supply, circuit.shape)
        end = _bisect(circuit, _saturated, zero, nodes, outside, _SATURATION_HALVINGS)
        ends.append(np.where(usable, end, np.nan))
        stable_ends.append(np.where(usable & quiet, _stable_end(circuit, nodes, end), np.nan))
    return InputRange(*ends, *stable_ends)


def _stable_end(circuit: AmplifierCircuit, nodes: Array, end: Array) -> Array:
    """Return the input nearest to `end` [V] up to which the follower is stable, from its nodes at 0 V."""
    grid = _GRID[:, None] * end
    at_grid = circuit.operating_point(grid, _moved(circuit, nodes, grid), _LAST_CHANGE)
    stable = circuit.stable(at_grid, grid)
    wrong: Mask = np.asarray(~stable.all(axis=0))
    if not wrong.any():
        return end
    first = np.argmin(stable, axis=0)[wrong]
    few = _chosen(circuit, wrong)
    columns = np.arange(first.size)
    inputs = np.concatenate([np.zeros((1, first.size)), grid[:, wrong]])
    places = np.concatenate([nodes[None, wrong], at_grid[:, wrong]])
    inside, outside = inputs[first, columns], inputs[first + 1, columns]
    result: Array = np.array(end)
    result[wrong] = _bisect(few, AmplifierCircuit.stable, inside, places[first, columns], outside, _STABILITY_HALVINGS)
    return result


def _bisect(
    circuit: AmplifierCircuit,
    within: Callable[[AmplifierCircuit, Array, Array], Mask],
    inside: Array,
    nodes: Array,
    outside: Array,
    halvings: int,
) -> Array:
    """Return the last input within [V]; the nodes there are the start of the next operating point."""
    for _ in range(halvings):
        middle = 0.5 * (inside + outside)
        found = circuit.operating_point(middle, _moved(circuit, nodes, middle - inside), _LAST_CHANGE)
        good = within(circuit, found, middle)
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
        nodes = np.where(good[..., None], found, nodes)
    return inside


def _moved(circuit: AmplifierCircuit, nodes: Array, change: Array) -> Array:
    """Return a guess of the nodes after a change of the input [V]: output and tail follow it."""
    follow = np.array([name in ("out", "tail") for name in UNKNOWNS[circuit.stages]])
    return np.asarray(nodes + change[..., None] * follow)


def _saturated(circuit: AmplifierCircuit, nodes: Array, v_in: Array) -> Mask:
    current = np.abs(circuit.transistors(nodes, v_in)[2].current)
    driven = current[..., 6] >= MIN_OUTPUT_CURRENT * current[..., 7]
    return np.asarray(circuit.saturated(nodes, v_in).all(axis=-1) & driven)


def _chosen(circuit: AmplifierCircuit, mask: Mask) -> AmplifierCircuit:
    parts = {item.name: getattr(circuit, item.name) for item in dataclasses.fields(circuit) if item.name != "stages"}
    return AmplifierCircuit(circuit.stages, **{name: part[mask] for name, part in parts.items()})
