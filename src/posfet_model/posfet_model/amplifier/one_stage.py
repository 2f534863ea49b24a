# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One-stage op-amp with the sizes of Table II and an n-channel output follower, by hand formulas.

    M1, M2 (inverting)   POSFET input pair            M5, M6, M8  n-channel current mirror fed by the reference current
    M3, M4               p-channel mirror load        M7          n-channel source follower; Cc from its gate to ground

Formulas as in `two_stage`. The printed width of M7 would suit either circuit.
"""

from __future__ import annotations

import math
from typing import Final

from posfet_model._lib.validation import instance
from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.operating_point import (
    TABLE_II,
    AmplifierBias,
    AmplifierDesign,
    NotSaturatedError,
    OpAmpFigures,
    OperatingPoint,
    bisect,
    lowest_input,
    operating_point,
    saturated,
)

CIRCUIT_C: Final = AmplifierBias(
    reference_current=100e-6, compensation=33e-12, zero_resistor=0.0, load_resistance=1e15, modulation=0.0248
)
"""Bias of circuit C, fitted to 42.3 dB and 1.5 MHz, all assumed."""


def one_stage_figures(bias: AmplifierBias = CIRCUIT_C, design: AmplifierDesign = TABLE_II) -> OpAmpFigures:
    """Return gain, poles and slew rate, symmetrical for rise and fall; the bias's zero_resistor is not used.

    `second_gain` is gm7/(gm7 + gds7 + gds8 + 1/RL), the second pole that of the output follower and its load.

    Parameters
    ----------
    bias : AmplifierBias, default CIRCUIT_C
        Bias of the circuit.
    design : AmplifierDesign, default TABLE_II
        Sizes and process.

    Returns
    -------
    OpAmpFigures
        Figures of merit at rest; all NaN, with the reason in `reasons`, where the supply is too low for the transistors
        to be saturated.

    Raises
    ------
    ValueError
        An argument is of another type.

    Notes
    -----
    Compared with ngspice with the defaults (circuit C): open-loop gain +3.4 %, dominant pole -4 %, second pole +16 %,
    slew rate 3.22 V/us instead of 3.29 rising and 3.04 falling: the tail current, computed at 0 V, varies with the
    input by lambda.
    """
    bias, design = instance("bias", bias, AmplifierBias), instance("design", design, AmplifierDesign)
    try:
        return _figures(bias, design)
    except NotSaturatedError as error:
        return OpAmpFigures.unknown(error)


def _figures(bias: AmplifierBias, design: AmplifierDesign) -> OpAmpFigures:
    point = operating_point(bias, design)
    lam, half = bias.modulation, point.tail / 2
    overdrive7 = math.sqrt(2 * point.output / (design.n_factor("M7") * (1 + lam * bias.supply)))
    first = bias.threshold + overdrive7  # [V], of the gate of M7 with the output at 0 V
    if first + point.load_overdrive > bias.supply:
        raise NotSaturatedError(f"supply must keep every transistor saturated, got {bias.supply:g} V")
    below, above = first + point.pair_threshold + point.pair_overdrive, bias.supply - first  # of M2 and M4
    out1 = lam * half / (1 + lam * below) + lam * half / (1 + lam * above)
    gm1, gm7 = point.tail / point.pair_overdrive, 2 * point.output / overdrive7
    out2 = gm7 + 2 * lam * point.output / (1 + lam * bias.supply) + 1 / bias.load_resistance
    c7 = design.gate_capacitance("M7")
    c1 = bias.compensation + c7 * (1 - gm7 / out2)
    second_pole = out2 / (2 * math.pi * (design.output_capacitance(bias.load_capacitance) + c7))
    slew_rate = point.tail / c1
    return OpAmpFigures(
        tail_current=point.tail,
        overdrive=point.pair_overdrive,
        input_transconductance=gm1,
        first_gain=gm1 / out1,
        second_gain=gm7 / out2,
        dominant_pole=out1 / (2 * math.pi * c1),
        second_pole=second_pole,
        slew_rate=slew_rate,
        limits=FollowerLimits(
            v_low=lowest_input(bias, point),
            v_high=_highest_input(bias, design, point),
            slew_rate=slew_rate,
            frequency=second_pole,
        ),
    )


def _highest_input(bias: AmplifierBias, design: AmplifierDesign, point: OperatingPoint) -> float:
    """Return the highest input [V] that keeps M1 and M4 saturated, M4 a gate-source voltage of M7 above the output."""
    highest = bias.supply - point.load_overdrive - bias.threshold

    def margin(overdrive: float) -> float:
        below = bias.supply - highest + overdrive  # M7's drain-source voltage
        return saturated(design.n_factor("M7"), overdrive, below, bias.modulation) - point.output_demand(
            bias, highest - overdrive
        )

    pair = bias.supply - point.load_overdrive + design.pair_threshold_shift
    return min(highest - bisect(margin, 0.0, 2 * bias.supply), pair)
