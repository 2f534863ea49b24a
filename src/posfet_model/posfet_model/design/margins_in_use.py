# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Phase margin and overshoot over the inputs that a design uses, from 0 V to that of the force to be measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import FloatArray
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import Margins
from posfet_model.amplifier.open_loop import LEAST_PHASE_MARGIN, MOST_OVERSHOOT
from posfet_model.design.amplifier_figures import BLOCK, AmplifierFigures, circuit_blocks

SHARES: Final = (0.5, 1.0)
"""Inputs that are examined besides 0 V, in that of the force."""

_INPUTS: Final = 51


@dataclass(frozen=True, eq=False)
class MarginsInUse:
    """The worst at any examined input that has an operating point."""

    phase_margin: FloatArray
    """Least phase margin [degrees]; NaN where the loop gain never is 1."""
    overshoot: FloatArray
    """Largest overshoot of a small step [1]; NaN where unstable at all of them."""


def margins_in_use(circuit: AmplifierCircuit, amplifier: AmplifierFigures, reach: FloatArray) -> MarginsInUse:
    """Return the worst margins between 0 V and other inputs; unchecked.

    Parameters
    ----------
    circuit : AmplifierCircuit
        One circuit, or arrays of them.
    amplifier : AmplifierFigures
        Its figures at 0 V.
    reach : float or ndarray
        Other end of the inputs [V]; broadcasts with the circuits.
    """
    shape = np.broadcast_shapes(circuit.shape, np.shape(reach))
    volts = np.broadcast_to(reach, shape).reshape(-1)
    parts = [
        _worst(block, volts[BLOCK * k : BLOCK * (k + 1)]) for k, block in enumerate(circuit_blocks(circuit, shape))
    ]
    margin, overshoot = (np.concatenate(column).reshape(shape) for column in zip(*parts, strict=True))
    return MarginsInUse(np.fmin(margin, amplifier.phase_margin)[()], np.fmax(overshoot, amplifier.overshoot)[()])


def _worst(circuit: AmplifierCircuit, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    inputs = np.multiply.outer(SHARES, reach)
    with np.errstate(divide="ignore", invalid="ignore"):  # transistors in cut-off
        margins = Margins.at(circuit, circuit.operating_point(inputs), inputs)
    return np.fmin.reduce(margins.phase_margin), np.fmax.reduce(margins.overshoot)


def quiet_range(circuit: AmplifierCircuit, low: float, high: float) -> tuple[float, float]:
    """Return the part around 0 V of a range of inputs [V] in which a single circuit keeps its margins; unchecked.

    Parameters
    ----------
    circuit : AmplifierCircuit
        A single circuit with its margins at 0 V.
    low, high : float
        Ends of the range [V], on either side of 0.

    Returns
    -------
    tuple of float
        Ends, to a fiftieth of the range.
    """
    ends = []
    for end in (low, high):
        inputs = np.linspace(0.0, end, _INPUTS)
        margins = Margins.at(circuit, circuit.operating_point(inputs), inputs)
        bad = (margins.phase_margin < LEAST_PHASE_MARGIN) | (margins.overshoot > MOST_OVERSHOOT)
        ends.append(float(inputs[np.argmax(bad) - 1]) if bad.any() else end)
    return ends[0], ends[1]
