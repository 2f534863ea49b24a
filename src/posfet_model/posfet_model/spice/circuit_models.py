# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Models of a circuit, by what they are made of: sizes and bias, given figures, or the operating point of a netlist."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from posfet_model.amplifier.calibration import calibrate_circuit
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.follower_base import Follower
from posfet_model.amplifier.one_stage import CIRCUIT_C
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.operating_point import CIRCUIT_B
from posfet_model.amplifier.transient_follower import CircuitFollower, SlewingFollower
from posfet_model.amplifier.undetermined import NEAR_REST
from posfet_model.spice.circuits import Circuit
from posfet_model.spice.measurement import BiasPoint
from posfet_model.spice.record_file import Record
from posfet_model.spice.recorded_runs import time_scale
from posfet_model.spice.stimuli import stimuli

LEAST_MARGIN: Final = -85.0
"""Least phase margin of an op-amp of given figures [degrees]."""


@dataclass(frozen=True, eq=False)
class CircuitModel:
    """A follower in time and its figures of merit."""

    follower: Follower
    """Output over time, with its range of validity."""
    gain: float
    """A0 [V/V]."""
    closed_loop_gain: float
    """Gain of the follower at frequency 0 [V/V]."""
    unity_crossing: float
    """[Hz]."""
    phase_margin: float
    """[degrees]."""
    stable: bool
    """Whether the follower is stable."""
    usable: bool
    """Whether the model declares the design valid."""


def from_sizes(circuit: Circuit, record: Record | None = None) -> CircuitModel:
    """Return the model from sizes, bias, compensation and load alone; unchecked."""
    del record
    return _of_circuit(AmplifierCircuit.from_design(circuit.bias, circuit.design, circuit.stages))


def from_operating_point(circuit: Circuit, record: Record) -> CircuitModel:
    """Return the model from ngspice's operating point and the netlist's resistors and capacitors; unchecked."""
    return _of_circuit(extracted(circuit, record.bias_point))


def from_figures(circuit: Circuit, record: Record) -> CircuitModel:
    """Return the model from figures as ngspice shows them; unchecked.

    Gain of the follower at low frequency, unity crossing and phase margin of the loop, the steepest rise, and the range
    of inputs at which it was stable.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    record : Record
        What ngspice says about it.
    """
    loop, gain = record.exact_loop, record.follower_gain / (1 - record.follower_gain)
    open_loop = OpenLoop.from_phase_margin(gain, loop.unity_crossing, max(loop.phase_margin, LEAST_MARGIN))
    rise = record.slew_rates[0]
    follower = SlewingFollower(
        open_loop=open_loop,
        slew_rate=rise if math.isfinite(rise) else _unlimited(open_loop),
        poles_known=False,
        known_inputs=_stable_inputs(circuit, record),
    )
    return CircuitModel(
        follower=follower,
        gain=float(open_loop.gain),
        closed_loop_gain=float(open_loop.closed_loop_gain),
        unity_crossing=float(open_loop.gain_bandwidth),
        phase_margin=float(open_loop.phase_margin),
        stable=bool(open_loop.stable),
        usable=bool(follower.validity.valid),
    )


def _unlimited(open_loop: OpenLoop) -> float:
    """Return a slew rate [V/s] that no step of some volts reaches."""
    return 1e3 * float(open_loop.gain_pole_product)


def _stable_inputs(circuit: Circuit, record: Record) -> tuple[float, float]:
    """Return the lowest and the highest input [V] at which ngspice showed the circuit to be stable."""
    inputs = stimuli(circuit, time_scale(record.loop))
    ran = [inputs[name].volts for name in record.runs]
    return min((float(one.min()) for one in ran), default=0.0), max((float(one.max()) for one in ran), default=0.0)


def _of_circuit(
    circuit: AmplifierCircuit, *, poles_known: bool = True, known_inputs: tuple[float, float] = NEAR_REST
) -> CircuitModel:
    follower = CircuitFollower(circuit=circuit, poles_known=poles_known, known_inputs=known_inputs)
    figures = follower.figures
    return CircuitModel(
        follower=follower,
        gain=float(figures.gain),
        closed_loop_gain=float(figures.closed_loop_gain),
        unity_crossing=float(figures.gain_bandwidth),
        phase_margin=float(figures.phase_margin),
        stable=bool(figures.stable),
        usable=bool(figures.validity.valid),
    )


def extracted(circuit: Circuit, point: BiasPoint) -> AmplifierCircuit:
    """Return the circuit of which each transistor has the current, gm, gds and Cgs of an operating point.

    A square law is laid through the point of each: ``Vov = 2*I/gm``, ``lambda = gds/(I - gds*Vds)``, gate ``3/2*Cgs``.
    Resistors, capacitors and supplies are the circuit's; sizes and process are not used. So a netlist with other
    transistors than the level 1 model can be followed, too, near the operating point.

    Parameters
    ----------
    circuit : Circuit
        The circuit, for its resistors, capacitors and supplies.
    point : BiasPoint
        Operating point, from `measurement.measure_bias_point` or any simulator.

    Returns
    -------
    AmplifierCircuit
        The circuit.
    """
    names = [f"M{number}" for number in range(1, 9)]
    rows = [point.transistors[name] for name in names]
    current, gate, drain, gm, gds, area = (
        np.array([getattr(row, name) for row in rows])
        for name in (
            "current",
            "gate_voltage",
            "drain_voltage",
            "transconductance",
            "output_conductance",
            "gate_source_capacitance",
        )
    )
    overdrive = 2 * current / gm
    modulation = gds / (current - gds * drain)
    bias = circuit.bias
    return AmplifierCircuit(
        stages=circuit.stages,
        beta=gm / (overdrive * (1 + modulation * drain)),
        gate_area=1.5 * area,
        threshold=gate - overdrive,
        modulation=np.asarray(modulation.mean()),
        supply=np.asarray(bias.supply),
        reference_current=np.asarray(current[5]),
        compensation=np.asarray(bias.compensation),
        zero_resistor=np.asarray(bias.zero_resistor),
        load_resistance=np.asarray(bias.load_resistance),
        load_capacitance=np.asarray(bias.load_capacitance),
    )


def from_calibration(circuit: Circuit, record: Record) -> CircuitModel:
    """Return the model from sizes and bias current, and gain, unity crossing and phase margin as ngspice shows them.

    Compensation, load capacitance, and load resistance or lambda are not taken from the circuit but found; the search
    starts at those of circuits B and C. Unchecked.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    record : Record
        What ngspice says about it.
    """
    start = CIRCUIT_B if circuit.stages == 2 else CIRCUIT_C
    names = ("compensation", "load_capacitance", "load_resistance" if circuit.stages == 2 else "modulation")
    bias = replace(circuit.bias, **{name: getattr(start, name) for name in names})
    design, loop = AmplifierCircuit.from_design(bias, circuit.design, circuit.stages), record.exact_loop
    margin = max(loop.phase_margin, LEAST_MARGIN)
    return _of_circuit(calibrate_circuit(design, record.open_loop.gain, loop.unity_crossing, margin))


def from_measured_figures(circuit: Circuit, record: Record) -> CircuitModel:
    """Return the op-amp of the paper, adjusted to figures as ngspice shows them, and to nothing of the circuit itself.

    Gain, unity crossing and phase margin of the op-amp, bandwidth of the follower, slew rates, and the range of inputs
    at which it was stable, as of a design file that has nothing but ``stages`` and ``measured``. Where no such op-amp
    has them, the slew rates are left out, and where that does not help either, it is the model `from_figures`.
    Unchecked.

    Parameters
    ----------
    circuit : Circuit
        The circuit, for its number of stages.
    record : Record
        What ngspice says about it.
    """
    start = AmplifierCircuit.from_design(CIRCUIT_B if circuit.stages == 2 else CIRCUIT_C, stages=circuit.stages)
    seen, (rise, fall) = record.exact_loop, record.slew_rates
    loop = record.open_loop.gain, seen.unity_crossing, max(seen.phase_margin, LEAST_MARGIN)
    bandwidth = record.bandwidth if circuit.stages == 2 and seen.stable else None
    for slews in ((rise, fall), (rise, None), (None, None)):
        up, down = slews if seen.stable else (None, None)
        try:
            found = calibrate_circuit(start, *loop, bandwidth=bandwidth, slew_rate=up, falling_slew_rate=down)
        except ValueError:
            continue
        return _of_circuit(found, poles_known=False, known_inputs=_stable_inputs(circuit, record))
    return from_figures(circuit, record)


WAYS: Final[Mapping[str, Callable[[Circuit, Record], CircuitModel]]] = {
    "sizes": from_sizes,
    "given": from_figures,
    "measured": from_measured_figures,
    "calibrated": from_calibration,
    "operating_point": from_operating_point,
}
"""What a model is made of, by name."""
