# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Why a run of an op-amp circuit is not valid at an input: out of range, cut off, unstable, or about to ring.

A load resistor takes the current from M7 at low inputs: with two stages the second pole falls with it, so that a
follower that is quiet at 0 V may ring, or oscillate, at another input. All but the cut-off is a property of the circuit
at rest at the input: it is computed at the inputs that occur or, where they are many, at some between their ends.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import Margins
from posfet_model.amplifier.open_loop import LEAST_PHASE_MARGIN, MOST_OVERSHOOT
from posfet_model.amplifier.operating_point import MIN_OUTPUT_CURRENT

INPUT_RANGE: Final = "input stage out of its common-mode range"
OUTPUT_RANGE: Final = "output stage out of saturation: too near a rail, or too much load"
CUT_OFF: Final = "output stage cut off: the step is steeper than M8 can sink"
UNSTABLE_HERE: Final = "unstable at this input: the follower oscillates"
LOW_MARGIN_HERE: Final = f"phase margin below {LEAST_PHASE_MARGIN:g} degrees at this input"
RINGS_HERE: Final = f"a step at this input overshoots by more than {100 * MOST_OVERSHOOT:g} %"
SLEW_RATE_NOT_GIVEN: Final = "slew rate not given, and the input pair is driven out of its linear range"

LINEAR_INPUT: Final = 0.06
"""Difference of the inputs [V] up to which an op-amp of unknown slew rate is taken for linear, assumed: a pair with an
overdrive of 0.3 V is 0.5 % less steep there."""

POINTS: Final = 65
"""Most inputs at which a circuit is examined; between them its margins are interpolated."""


def input_findings(
    circuit: AmplifierCircuit, nodes: Array, v_in: Array, *, slew_rate_known: bool = True
) -> dict[str, Mask]:
    """Return why a circuit is not in its range: at rest at the input, or in the moment; unchecked.

    Parameters
    ----------
    circuit : AmplifierCircuit
        The circuit, of a shape that broadcasts to that of `v_in` without its first axis.
    nodes : ndarray
        Voltages of the unknown nodes [V], shape [..., n].
    v_in : ndarray
        Input voltage [V], shape [...].
    slew_rate_known : bool, default True
        Whether the circuit slews as the op-amp does that it stands for.

    Returns
    -------
    dict
        Mask of the shape [...] by reason.
    """
    many = v_in.reshape(-1) if not circuit.shape else v_in.reshape(-1, *v_in.shape[v_in.ndim - len(circuit.shape) :])
    known: Array = np.unique(many) if many.ndim == 1 else many
    if len(known) <= POINTS:
        margins = _margins(circuit, known)
        spread = margins if many.ndim > 1 else [part[np.searchsorted(known, many)] for part in margins]
    else:
        low, high = many.min(axis=0), many.max(axis=0)
        shares = np.linspace(0.0, 1.0, POINTS).reshape(-1, *(1,) * low.ndim)
        margins = _margins(circuit, low + shares * (high - low))
        place = (POINTS - 1) * (many - low) / np.where(high > low, high - low, 1.0)
        below = np.minimum(place.astype(np.intp), POINTS - 2)
        spread = [_between(part, below, place - below) for part in margins]
    pair, output, current, decay, margin, calm, rest = (part.reshape(v_in.shape) for part in spread)
    gate, _, _ = circuit.transistors(nodes, v_in)
    found: dict[str, Mask] = {
        INPUT_RANGE: ~(pair >= 0),
        OUTPUT_RANGE: ~((output >= 0) & (current >= 0)),
        CUT_OFF: circuit.polarity[6] * gate[..., 6] <= circuit.threshold[..., 6],
        UNSTABLE_HERE: decay <= 0,
        LOW_MARGIN_HERE: (margin < 0) & ~(decay <= 0),
        RINGS_HERE: calm < 0,
    }
    if not slew_rate_known:
        found[SLEW_RATE_NOT_GIVEN] = np.abs(circuit.output(nodes) - rest) > LINEAR_INPUT
    return found


def _margins(circuit: AmplifierCircuit, v_in: Array) -> list[Array]:
    """Return by how much followers at rest are within each limit, and their output [V]; NaN where unknown."""
    nodes = circuit.operating_point(v_in)
    gate, drain, point = circuit.transistors(nodes, v_in)
    overdrive = circuit.polarity * gate - circuit.threshold
    saturated = np.minimum(overdrive, circuit.polarity * drain - overdrive)
    current = np.abs(point.current)
    with np.errstate(divide="ignore", invalid="ignore"):  # of transistors in cut-off
        margins = Margins.at(circuit, nodes, v_in)
    return [
        saturated[..., :5].min(axis=-1),
        saturated[..., 6:].min(axis=-1),
        current[..., 6] / current[..., 7] - MIN_OUTPUT_CURRENT,
        margins.decay,
        margins.phase_margin - LEAST_PHASE_MARGIN,
        MOST_OVERSHOOT - margins.overshoot,
        circuit.output(nodes),
    ]


def _between(table: Array, below: NDArray[np.intp], share: Array) -> Array:
    """Return the values of a table [points, ...] at a share of the way from one point to the next."""
    low, high = np.take_along_axis(table, below, 0), np.take_along_axis(table, below + 1, 0)
    return np.asarray(low + share * (high - low))
