# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Figures of merit of the op-amp of a design and of its follower, for one circuit or for arrays of circuits.

The circuit is linearised at its operating point and solved exactly (`circuit_figures`); nothing is fitted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from posfet_model._lib.types import Array, FloatArray, Mask
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import CircuitFigures, circuit_figures
from posfet_model.amplifier.input_range import input_range
from posfet_model.amplifier.validity import Validity

BLOCK: Final = 500
"""Circuits that are computed at once, which bounds the memory."""

_OF_EACH_TRANSISTOR: Final = ("beta", "gate_area", "threshold")


@dataclass(frozen=True, eq=False, kw_only=True)
class AmplifierFigures:
    """Figures of merit at rest with the input at 0 V, all of the designs' shape; NaN without an operating point."""

    found: Mask
    """Where there is an operating point."""
    tail_current: FloatArray
    """Current through M5 [A]."""
    output_current: FloatArray
    """Current through M7 [A]."""
    supply_current: FloatArray
    """Current from the positive supply, with the reference current [A]."""
    overdrive: FloatArray
    """Overdrive of M2 [V]."""
    input_transconductance: FloatArray
    """gm of M2 [S], for the voltage of the top electrode."""
    load_transconductance: FloatArray
    """gm of M3 [S]."""
    open_loop_gain: FloatArray
    """A0 [V/V]."""
    dominant_pole: FloatArray
    """Dominant pole of the open loop [Hz]."""
    second_pole: FloatArray
    """Magnitude of the next pole of the open loop [Hz]."""
    gain_bandwidth: FloatArray
    """Frequency at which the open-loop gain is 1 [Hz]; NaN where it never is."""
    phase_margin: FloatArray
    """Phase margin [degrees]; NaN where the gain never is 1."""
    stable: Any
    """Whether the follower is stable; False without an operating point."""
    overshoot: FloatArray
    """Overshoot of a small step of the follower [1]; NaN where unstable."""
    settling_time: FloatArray
    """Time after which a small step stays within 1 % [s]; inf where unstable."""
    follower_gain: FloatArray
    """Gain of the follower at frequency 0 [V/V]."""
    bandwidth: FloatArray
    """Frequency at which the gain of the follower has fallen by 3 dB [Hz]; NaN where unstable."""
    slew_rate: FloatArray
    """Steepest rise of the output [V/s]."""
    falling_slew_rate: FloatArray
    """Steepest fall of the output [V/s]."""
    offset: FloatArray
    """Systematic offset: output with the input at 0 V [V]."""
    pair_modulation: FloatArray
    """gds/I of M2 [1/V]."""
    tail_modulation: FloatArray
    """gds/I of M5 [1/V]."""
    common_mode_rejection: FloatArray
    """CMRR without mismatch: difference gain over common-mode gain at frequency 0 [V/V]."""
    lowest_input: FloatArray
    """Lowest input with all transistors saturated and the follower stable [V]; NaN where it is not so at 0 V."""
    highest_input: FloatArray
    """Highest input with all transistors saturated and the follower stable [V]; NaN where it is not so at 0 V."""
    lowest_saturated_input: FloatArray
    """Lowest input with all transistors saturated [V], stable or not; NaN where they are not at 0 V."""
    highest_saturated_input: FloatArray
    """Highest input with all transistors saturated [V], stable or not; NaN where they are not at 0 V."""
    validity: Validity
    """Where the follower is usable, and why not."""

    @property
    def gain_db(self) -> FloatArray:
        """A0 [dB]."""
        return 20 * np.log10(self.open_loop_gain)

    @property
    def gain_pole_product(self) -> FloatArray:
        """A0 times the dominant pole [Hz]."""
        return self.open_loop_gain * self.dominant_pole


def amplifier_figures(circuit: AmplifierCircuit) -> AmplifierFigures:
    """Return the figures of merit of op-amp circuits as followers.

    Parameters
    ----------
    circuit : AmplifierCircuit
        One circuit, or arrays of them.

    Returns
    -------
    AmplifierFigures
        Figures of merit, of the circuits' shape.
    """
    blocks = [_block(block) for block in circuit_blocks(circuit, circuit.shape)]
    joined: dict[str, Any] = {}
    for item in dataclasses.fields(AmplifierFigures):
        parts = [getattr(block, item.name) for block in blocks]
        if item.name == "validity":
            masks = {reason: np.concatenate([part.findings[reason] for part in parts]) for reason in parts[0].findings}
            joined["validity"] = Validity({reason: mask.reshape(circuit.shape) for reason, mask in masks.items()})
        else:
            joined[item.name] = np.concatenate(parts).reshape(circuit.shape)[()]
    return AmplifierFigures(**joined)


def circuit_blocks(circuit: AmplifierCircuit, shape: tuple[int, ...]) -> Iterator[AmplifierCircuit]:
    """Yield circuits in blocks of shape [n], in C order; one empty block if there are none. Unchecked.

    Parameters
    ----------
    circuit : AmplifierCircuit
        One circuit, or arrays of them.
    shape : tuple of int
        Shape to which they are broadcast.
    """
    flat: dict[str, Array] = {}
    for item in dataclasses.fields(circuit):
        if item.name != "stages":
            part = np.asarray(getattr(circuit, item.name), np.float64)
            rest = (8,) if item.name in _OF_EACH_TRANSISTOR else ()
            flat[item.name] = np.broadcast_to(part, (*shape, *rest)).reshape(-1, *rest)
    for begin in range(0, max(math.prod(shape), 1), BLOCK):
        yield AmplifierCircuit(circuit.stages, **{name: part[begin : begin + BLOCK] for name, part in flat.items()})


def _block(circuit: AmplifierCircuit) -> AmplifierFigures:
    """Return the figures of circuits of the shape [n]."""
    with np.errstate(divide="ignore", invalid="ignore"):  # transistors in cut-off
        return _block_figures(circuit, circuit_figures(circuit))


def _block_figures(circuit: AmplifierCircuit, figures: CircuitFigures) -> AmplifierFigures:
    nodes = figures.nodes
    rest = np.zeros(nodes.shape[:-1])
    found = np.asarray(np.isfinite(nodes).all(axis=-1))
    gate, _, point = circuit.transistors(nodes, rest)
    gm = np.abs(point.transconductance)
    inputs = input_range(circuit, nodes)
    return AmplifierFigures(
        found=found,
        tail_current=figures.tail_current,
        output_current=figures.output_current,
        supply_current=figures.supply_current,
        overdrive=gate[..., 1] - circuit.threshold[..., 1],
        input_transconductance=gm[..., 1],
        load_transconductance=gm[..., 2],
        open_loop_gain=np.abs(figures.gain),
        dominant_pole=figures.open_loop_poles[..., 0],
        second_pole=figures.open_loop_poles[..., 1],
        gain_bandwidth=figures.gain_bandwidth,
        phase_margin=figures.phase_margin,
        stable=figures.stable & found,
        overshoot=figures.overshoot,
        settling_time=np.where(found, figures.settling_time, math.nan),
        follower_gain=figures.closed_loop_gain,
        bandwidth=np.where(figures.stable & found, figures.closed_loop_response.bandwidth, math.nan),
        slew_rate=figures.slew_rate,
        falling_slew_rate=figures.falling_slew_rate,
        offset=figures.offset,
        pair_modulation=point.output_conductance[..., 1] / point.current[..., 1],
        tail_modulation=point.output_conductance[..., 4] / point.current[..., 4],
        common_mode_rejection=figures.common_mode_rejection,
        lowest_input=inputs.lowest,
        highest_input=inputs.highest,
        lowest_saturated_input=inputs.lowest_saturated,
        highest_saturated_input=inputs.highest_saturated,
        validity=figures.validity,
    )
