# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The op-amp of a design as a circuit, of arrays or in numbers."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.operating_point import LARGEST_SHIFT, AmplifierBias, AmplifierDesign
from posfet_model.design.design_fields import PARTS, DesignFields
from posfet_model.device.paper import TransistorSize
from posfet_model.device.taxel_fields import Values
from posfet_model.device.transistor import CAPACITANCE_RANGE, Stack
from posfet_model.spice.circuits import Circuit


def op_amp_circuit(design: DesignFields) -> AmplifierCircuit:
    """Return the op-amp as a circuit, of arrays where the design has them; unchecked."""
    second = design.hole_mobility if design.stages == 2 else design.electron_mobility  # M7
    n, p, below = design.electron_mobility, design.hole_mobility, design.coupling
    mobility = (n, n, p, p, n, n, second, n)
    drive = np.asarray(design.oxide_capacitance)[..., None] * _each(below, below, 1, 1, 1, 1, 1, 1)
    width, length = (_each(*(getattr(design, f"{part}_{size}") for part in PARTS)) for size in ("width", "length"))
    plain = design.threshold_voltage
    return AmplifierCircuit(
        stages=design.stages,
        beta=_each(*mobility) * drive * width / length,
        gate_area=drive * width * length,
        threshold=_each(design.threshold, design.threshold, *(plain,) * 6),
        modulation=np.asarray(design.channel_length_modulation),
        supply=np.asarray(design.supply),
        reference_current=np.asarray(design.reference_current),
        compensation=np.asarray(design.compensation),
        zero_resistor=np.asarray(design.zero_resistor),
        load_resistance=np.asarray(design.load_resistance),
        load_capacitance=np.asarray(design.load_capacitance),
    )


def named_circuit(design: DesignFields, name: str) -> Circuit:
    """Return the circuit of a single design, for hand formulas and SPICE; unchecked.

    Parameters
    ----------
    design : DesignFields
        The design, of numbers.
    name : str
        Name of the circuit.

    Raises
    ------
    ValueError
        The name has other characters than letters, digits and underscores, or film and poling are beyond what a
        netlist can have.
    """
    shift, film = float(design.threshold - design.threshold_voltage), float(design.film_on_gate)
    if not abs(shift) <= LARGEST_SHIFT:
        raise ValueError(
            f"uncompensated_fraction must move the threshold of M1 and M2 by at most {LARGEST_SHIFT:g} V with this "
            f"film and poling for a netlist, got {shift:g} V"
        )
    if not film <= CAPACITANCE_RANGE[1]:
        raise ValueError(
            f"film_area must give a film of at most {CAPACITANCE_RANGE[1]:g} F for each m2 of gate_width*gate_length "
            f"for a netlist, got {film:g} F/m2"
        )
    return Circuit(
        name,
        design.stages,
        AmplifierBias(
            reference_current=float(design.reference_current),
            supply=float(design.supply),
            compensation=float(design.compensation),
            zero_resistor=float(design.zero_resistor),
            load_capacitance=float(design.load_capacitance),
            load_resistance=float(design.load_resistance),
            modulation=float(design.channel_length_modulation),
            threshold=float(design.threshold_voltage),
        ),
        AmplifierDesign(
            sizes=tuple(
                TransistorSize(
                    f"M{m}", float(getattr(design, f"{part}_width")), float(getattr(design, f"{part}_length"))
                )
                for m, part in enumerate(PARTS, 1)
            ),
            stack=Stack(oxide=float(design.oxide_capacitance), film=film),
            electron_mobility=float(design.electron_mobility),
            hole_mobility=float(design.hole_mobility),
            pair_threshold_shift=shift,
        ),
    )


def _each(*values: Values | int) -> Array:
    """Return one value for each transistor along a last axis."""
    return np.stack(np.broadcast_arrays(*(np.asarray(value, np.float64) for value in values)), axis=-1)
