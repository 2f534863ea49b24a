# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Figures of an op-amp circuit from its linearised node equations: gain, unity crossing, margin, ringing, slew rate.

The transfer functions (`transfer_function`) are exact for the circuit (`circuit`). `CircuitFigures.open_loop` is the
equivalent of two poles and a zero: the same gain, unity crossing and phase margin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import instance
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_topology import UNKNOWNS
from posfet_model.amplifier.open_loop import (
    GAIN_RANGE,
    LEAST_PHASE_MARGIN,
    LOW_MARGIN,
    MOST_OVERSHOOT,
    RINGS,
    UNSTABLE,
    OpenLoop,
)
from posfet_model.amplifier.transfer_function import (
    LoopGain,
    Modes,
    TransferFunction,
    loop_gain,
    step_figures,
    transfer_function,
    unity_crossing,
)
from posfet_model.amplifier.transient import Matrices
from posfet_model.amplifier.validity import Validity

NO_OPERATING_POINT: Final = "no operating point between the supplies"
NOT_SATURATED: Final = "a transistor is out of saturation at rest"

_COARSE: Final = 4  # an overshoot is then a hundredth of itself too small at most


def unloaded_response(circuit: AmplifierCircuit) -> TransferFunction:
    """Return the open-loop gain from the input to the output with the inverting input held; unchecked.

    The output then lacks the load of the inverting input, as where a large inductor closes the loop in a simulator.

    Parameters
    ----------
    circuit : AmplifierCircuit
        One circuit, or arrays of them, with an operating point at 0 V.

    Returns
    -------
    TransferFunction
        The gain.
    """
    nodes = circuit.operating_point()
    linear = circuit.evaluate(nodes, np.zeros(nodes.shape[:-1]), "ground")[1]
    return transfer_function(linear, UNKNOWNS[circuit.stages].index("out"))


@dataclass(frozen=True, eq=False)
class SmallSignals:
    """A follower linearised at its nodes at rest."""

    linear: Matrices
    """The follower."""
    held: Matrices
    """The same with its inverting input held."""
    closed: TransferFunction
    """From its input to its output."""
    loop: LoopGain
    """Its loop gain."""

    @classmethod
    def at(cls, circuit: AmplifierCircuit, nodes: Array, v_in: Array) -> SmallSignals:
        """Return a follower linearised at nodes [V], shape [..., n], and an input [V]; unchecked."""
        output = UNKNOWNS[circuit.stages].index("out")
        linear, held = circuit.evaluate(nodes, v_in)[1], circuit.evaluate(nodes, v_in, "ground")[1]
        modes = Modes.of(linear)
        closed = modes.transfer(linear.input_conductance, linear.input_capacitance, output)
        return cls(linear, held, closed, loop_gain(modes, held, output))


@dataclass(frozen=True, eq=False)
class Margins:
    """How far followers at rest are from ringing; NaN without an operating point."""

    phase_margin: Array
    """[degrees]; NaN where the loop gain never is 1."""
    overshoot: Array
    """Overshoot of a small step [1]; NaN where unstable."""
    decay: Array
    """Slowest rate at which a disturbance decays [1/s]; not positive where unstable."""

    @classmethod
    def at(cls, circuit: AmplifierCircuit, nodes: Array, v_in: Array) -> Margins:
        """Return the margins of followers at their nodes at rest [V], shape [..., n], and an input [V]; unchecked."""
        found: Mask = np.asarray(np.isfinite(nodes).all(axis=-1))
        small = SmallSignals.at(circuit, np.where(found[..., None], nodes, circuit.start(v_in)), v_in)
        crossing, margin = unity_crossing(small.loop)
        excess, _ = step_figures(small.closed, _COARSE)
        ringing = np.where(small.closed.stable & np.isfinite(crossing), excess, np.nan)
        nothing = np.where(found, 1.0, np.nan)
        return cls(margin * nothing, ringing * nothing, small.closed.rates.real.min(axis=-1) * nothing)


@dataclass(frozen=True, eq=False)
class CircuitFigures:
    """Figures of merit of op-amp circuits as followers, all of the circuits' shape; NaN where there is no value."""

    nodes: Array
    """Voltages of the unknown nodes at rest [V], shape [..., n]."""
    loop_gain: LoopGain
    """Loop gain, with the load of the inverting input."""
    open_loop_poles: Array
    """Magnitudes of the poles of the open loop [Hz], shape [..., n], lowest first."""
    closed_loop_response: TransferFunction
    """From the input to the output of the follower."""
    gain: Array
    """Open-loop gain A0, from the input to the output with the inverting input held [V/V]."""
    common_mode_rejection: Array
    """Difference gain over common-mode gain at frequency 0, without mismatch [V/V]."""
    closed_loop_gain: Array
    """Gain of the follower at frequency 0 [V/V], with the common-mode gain, which A0/(1 + A0) lacks."""
    gain_bandwidth: Array
    """Unity crossing of the loop gain [Hz]."""
    phase_margin: Array
    """180 degrees plus the phase there [degrees]."""
    overshoot: Array
    """Overshoot of a small step, as a fraction of it [1]; NaN where unstable or without a unity crossing."""
    settling_time: Array
    """Time after which a small step stays within 1 % [s], to 2 % of itself, or a swing where it rings; inf where
    unstable."""
    slew_rate: Array
    """Steepest rise of the output [V/s]."""
    falling_slew_rate: Array
    """Steepest fall of the output [V/s]."""
    offset: Array
    """Output with the input at rest, less that input [V]."""
    tail_current: Array
    """Current of M5 [A]."""
    output_current: Array
    """Current of M7 [A]."""
    supply_current: Array
    """Current from the positive supply, with the reference current [A]."""
    validity: Validity
    """Whether the follower is usable, and why not."""

    @property
    def gain_db(self) -> Array:
        """A0 [dB]."""
        return np.asarray(20 * np.log10(np.abs(self.gain)))

    @property
    def stable(self) -> Mask:
        """Whether the follower is stable."""
        return self.closed_loop_response.stable

    @property
    def open_loop(self) -> OpenLoop:
        """Equivalent op-amp of two poles and a zero, of the same gain, unity crossing and phase margin."""
        return OpenLoop.from_phase_margin(
            np.clip(self.gain, 1.01, GAIN_RANGE[1]), self.gain_bandwidth, np.clip(self.phase_margin, -85, 179)
        )


def circuit_figures(circuit: AmplifierCircuit, v_in: float | Array = 0.0) -> CircuitFigures:
    """Return the figures of merit of op-amp circuits as followers.

    Parameters
    ----------
    circuit : AmplifierCircuit
        One circuit, or arrays of them.
    v_in : float or ndarray, default 0.0
        Input voltage at rest [V]; broadcasts with the circuits.

    Returns
    -------
    CircuitFigures
        Figures of merit, of the circuits' shape.

    Raises
    ------
    ValueError
        `circuit` is not an AmplifierCircuit.

    Notes
    -----
    The slew rates are hand formulas: rise by the tail current into Cc, Cc also moving the gate of M7; fall by the same,
    or by what M8 can sink from Cc and the load.
    """
    circuit = instance("circuit", circuit, AmplifierCircuit)
    nodes = circuit.operating_point(v_in)
    found: Mask = np.asarray(np.isfinite(nodes).all(axis=-1))
    v_in = np.broadcast_to(np.asarray(v_in, np.float64), found.shape)
    safe = np.where(found[..., None], nodes, circuit.start(v_in))
    output = UNKNOWNS[circuit.stages].index("out")
    small = SmallSignals.at(circuit, safe, v_in)
    linear, held, closed = small.linear, small.held, small.closed
    crossing, margin = unity_crossing(small.loop)
    noninverting = _gain(held.conductance, held.input_conductance, output)
    inverting = _gain(held.conductance, (held.conductance - linear.conductance)[..., output], output)
    poles = np.abs(np.linalg.eigvals(np.linalg.solve(held.capacitance, held.conductance))) / (2 * math.pi)
    stable = closed.stable & found
    overshoot, settling = step_figures(closed)
    currents = circuit.transistors(safe, v_in)[2]
    tail, sunk = currents.current[..., 4], currents.current[..., 7]
    with np.errstate(divide="ignore", invalid="ignore"):  # of a pair or an output stage that is cut off
        rise, fall = _slew_rates(circuit, currents.transconductance, currents.output_conductance, tail, sunk)
    saturated = circuit.saturated(safe, v_in).all(axis=-1)
    nothing = np.where(found, 1.0, np.nan)
    overshoot = np.where(stable & np.isfinite(crossing), overshoot, np.nan)
    return CircuitFigures(
        nodes=nodes,
        loop_gain=small.loop,
        open_loop_poles=np.sort(poles, axis=-1) * nothing[..., None],
        closed_loop_response=closed,
        gain=noninverting * nothing,
        common_mode_rejection=_rejection(noninverting, inverting) * nothing,
        closed_loop_gain=closed.gain * nothing,
        gain_bandwidth=crossing * nothing,
        phase_margin=margin * nothing,
        overshoot=overshoot,
        settling_time=np.where(stable, settling, np.inf),
        slew_rate=rise * nothing,
        falling_slew_rate=fall * nothing,
        offset=(nodes[..., output] - v_in),
        tail_current=tail * nothing,
        output_current=np.abs(currents.current[..., 6]) * nothing,
        supply_current=(tail + np.abs(currents.current[..., 6]) + circuit.reference_current) * nothing,
        validity=Validity(
            {
                NO_OPERATING_POINT: ~found,
                NOT_SATURATED: found & ~saturated,
                UNSTABLE: ~closed.stable & found,
                LOW_MARGIN: margin < LEAST_PHASE_MARGIN,
                RINGS: overshoot > MOST_OVERSHOOT,
            }
        ),
    )


def _gain(conductance: Array, column: Array, output: int) -> Array:
    """Return the gain at frequency 0 [V/V] from an input with this column of conductances."""
    return np.asarray(-np.linalg.solve(conductance, column[..., None])[..., output, 0])


def _rejection(noninverting: Array, inverting: Array) -> Array:
    """Return difference over common-mode gain [V/V], of the magnitudes of the gains from either input."""
    with np.errstate(divide="ignore", invalid="ignore"):  # of a pair that is cut off
        return np.asarray(np.abs(0.5 * (noninverting + inverting) / (noninverting - inverting)))


def _slew_rates(circuit: AmplifierCircuit, gm: Array, gds: Array, tail: Array, sunk: Array) -> tuple[Array, Array]:
    """Return the steepest rise and fall of the output [V/s]."""
    area = circuit.gate_area
    if circuit.stages == 1:
        second = gm[..., 6] + gds[..., 6] + gds[..., 7] + 1 / circuit.load_resistance
        rate = tail / (circuit.compensation + 2 / 3 * area[..., 6] * (1 - gm[..., 6] / second))
        return rate, np.minimum(rate, sunk / circuit.load_capacitance)
    gain = gm[..., 6] / (gds[..., 6] + gds[..., 7] + 1 / circuit.load_resistance)
    rise = tail / (circuit.compensation * (1 + 1 / (gain * np.sqrt(1 + tail / sunk))))
    load = circuit.load_capacitance + area[..., 0] / 3
    return rise, np.minimum(rise, sunk / (circuit.compensation * (1 + 1 / gain) + load))
