# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Two-stage Miller op-amp with the sizes of Table II, by hand formulas: gain, poles, slew rate, offset.

    M1 (inverting), M2   POSFET input pair            M5, M6, M8  n-channel current mirror fed by the reference current
    M3, M4               p-channel mirror load        M7          p-channel second stage, Cc and Rz from gate to drain

All transistors follow the square law with channel-length modulation, in saturation, bodies tied to sources.
Formulas: Gray, Hurst, Lewis, Meyer, *Analysis and Design of Analog Integrated Circuits*, 5th ed., ch. 6 and 9; Allen
and Holberg, *CMOS Analog Circuit Design*, 3rd ed., sec. 6.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.operating_point import (
    CIRCUIT_B,
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

__all__ = [
    "CIRCUIT_B",
    "TABLE_II",
    "AmplifierBias",
    "AmplifierDesign",
    "AmplifierFigures",
    "figures_of_merit",
    "mismatch_offset",
]


@dataclass(frozen=True, kw_only=True)
class AmplifierFigures(OpAmpFigures):
    """Figures of merit by hand formulas, at rest with input and output near 0 V.

    `second_gain` is gm7/(gds7 + gds8 + 1/RL), `slew_rate` tail current over Cc.
    """

    output_current: float
    """Current through M7 [A]."""
    load_transconductance: float
    """gm3 [S]."""
    zero: float
    """1/(2*pi*Cc*(Rz - 1/gm7)) [Hz], positive in the left half-plane; inf when it is cancelled."""
    falling_slew_rate: float
    """Steepest fall [V/s], limited by the current that M8 sinks near 0 V, at most `slew_rate`. A steeper fall cuts M7
    off and ends in an overshoot that no model here reproduces."""
    bend: float
    """Quadratic lead [V]: deviation from linearity of the gate of M7 when it receives all of the tail current, referred
    to the output. The output of a follower leads by this voltage while it slews up."""
    systematic_offset: float
    """Output of the follower with its input at 0 V and matched pairs [V]."""


def figures_of_merit(bias: AmplifierBias = CIRCUIT_B, design: AmplifierDesign = TABLE_II) -> AmplifierFigures:
    """Return gain, poles, offset and slew rate of the two-stage op-amp, by default that of Table II.

    Parameters
    ----------
    bias : AmplifierBias, default CIRCUIT_B
        Bias of the circuit.
    design : AmplifierDesign, default TABLE_II
        Sizes and process.

    Returns
    -------
    AmplifierFigures
        Figures of merit at rest; all NaN, with the reason in `reasons`, where the supply is too low for the transistors
        to be saturated, or they are not at any input.

    Raises
    ------
    ValueError
        An argument is of another type.

    Notes
    -----
    Compared with ngspice with the defaults (circuit B): open-loop gain +1.6 %, dominant pole +2.3 %, offset 2.42
    instead of 2.45 mV. The poles are those of the two-node circuit, ``p1 = 1/a1`` and ``p2 = a1/a2``, valid while p2 is
    well above p1; the second gain is only about 4.3 here, so the textbook ``gm1/Cc`` and ``I/Cc`` are too high by a
    quarter. While the output slews up, M7 carries the tail current too, so gm7 and the second gain are those of that
    current; ngspice slews at 4.85 V/us, this formula gives 4.49.
    """
    bias, design = instance("bias", bias, AmplifierBias), instance("design", design, AmplifierDesign)
    try:
        return _figures(bias, design)
    except NotSaturatedError as error:
        return AmplifierFigures.unknown(error)


def _figures(bias: AmplifierBias, design: AmplifierDesign) -> AmplifierFigures:
    point = operating_point(bias, design)
    lam = bias.modulation
    gm1, gm3 = point.tail / point.pair_overdrive, point.tail / point.load_overdrive
    half = point.tail / 2
    out1 = lam * half / (1 + lam * point.pair_voltage) + lam * half / (1 + lam * point.load_voltage)
    gm7 = 2 * point.output / point.output_overdrive
    out2 = 2 * lam * point.output / (1 + lam * bias.supply) + 1 / bias.load_resistance
    first_gain, second_gain = gm1 / out1, gm7 / out2
    p1, p2 = _poles(bias, design, out1, out2, gm7)
    lead = bias.compensation * (bias.zero_resistor - 1 / gm7)
    slewing = _slewing(bias, design, point, second_gain)
    lowest, highest = lowest_input(bias, point), _highest_input(bias, design, point)
    if not lowest < highest:
        raise NotSaturatedError(
            "design must keep every transistor saturated at some input, got none: "
            "it needs a wider M7, a larger load_resistance or a higher supply"
        )
    return AmplifierFigures(
        tail_current=point.tail,
        output_current=point.output,
        overdrive=point.pair_overdrive,
        input_transconductance=gm1,
        load_transconductance=gm3,
        first_gain=first_gain,
        second_gain=second_gain,
        dominant_pole=p1,
        second_pole=p2,
        zero=1 / (2 * math.pi * lead) if lead else math.inf,
        slew_rate=slewing.rise,
        falling_slew_rate=slewing.fall,
        bend=slewing.bend,
        systematic_offset=(point.load_overdrive - point.output_overdrive) / first_gain,
        limits=FollowerLimits(
            v_low=lowest,
            v_high=highest,
            slew_rate=slewing.rise,
            falling_slew_rate=slewing.fall,
            frequency=p2,
        ),
    )


@dataclass(frozen=True)
class _Slewing:
    """Steepest rise and fall of the output [V/s], and its lead while it rises [V]."""

    rise: float
    fall: float
    bend: float


def _slewing(bias: AmplifierBias, design: AmplifierDesign, point: OperatingPoint, second_gain: float) -> _Slewing:
    """Return the slewing of the output: up with the tail current, which M7 carries too; down with the current of M8."""
    stronger = math.sqrt(1 + point.tail / point.output)  # gm7, and with it the second gain, over those at rest
    both_ends = 1 + 1 / (second_gain * stronger)  # the gate of M7 moves, too
    rise = point.tail / (bias.compensation * both_ends)
    sunk = bias.compensation * (1 + 1 / second_gain) + design.output_capacitance(bias.load_capacitance)
    gate_moves = point.output_overdrive * (point.tail / point.output) / (1 + stronger)
    return _Slewing(
        rise=rise,
        fall=min(rise, point.output / sunk),
        bend=0.5 * gate_moves**2 / point.output_overdrive / both_ends,
    )


def mismatch_offset(
    figures: AmplifierFigures,
    pair_threshold: float,
    load_threshold: float,
    pair_size: float,
    load_size: float,
) -> float:
    """Return the input offset [V] caused by small mismatch between the two sides.

    ``dV = dVth1 + gm3/gm1*dVth3 + Vov/2*(dbeta1/beta1 + dbeta3/beta3)``, first order of the pair's square law, with
    signs such that each term adds. For standard deviations of independent mismatch add the squares of the terms.

    Parameters
    ----------
    figures : AmplifierFigures
        Figures of merit of the amplifier.
    pair_threshold, load_threshold : float
        Threshold mismatch of M1, M2 and of M3, M4 [V], within +-1.
    pair_size, load_size : float
        Relative mismatch of the gain factors [1], within +-0.5.

    Returns
    -------
    float
        Input offset [V].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range.
    """
    figures = instance("figures", figures, AmplifierFigures)
    return (
        real_number("pair_threshold", pair_threshold, -1, 1)
        + figures.load_transconductance
        / figures.input_transconductance
        * real_number("load_threshold", load_threshold, -1, 1)
        + 0.5
        * figures.overdrive
        * (real_number("pair_size", pair_size, -0.5, 0.5) + real_number("load_size", load_size, -0.5, 0.5))
    )


def _highest_input(bias: AmplifierBias, design: AmplifierDesign, point: OperatingPoint) -> float:
    """Return the highest input [V] that keeps M1 and M7 saturated; M7's drain-source voltage is then its overdrive."""

    def margin(overdrive: float) -> float:
        most = saturated(design.p_factor("M7"), overdrive, overdrive, bias.modulation)
        return most - point.output_demand(bias, bias.supply - overdrive)

    pair = point.load_overdrive - design.pair_threshold_shift
    return bias.supply - max(pair, bisect(margin, 0.0, 2 * bias.supply))


def _poles(bias: AmplifierBias, design: AmplifierDesign, out1: float, out2: float, gm7: float) -> tuple[float, float]:
    """Return both poles [Hz] of the two nodes with conductances out1, out2 [S], coupled by Cc."""
    c1 = design.gate_capacitance("M7")
    c2 = design.output_capacitance(bias.load_capacitance)
    cc = bias.compensation
    a1 = (c1 + cc) / out1 + (c2 + cc) / out2 + gm7 * cc / (out1 * out2)
    a2 = (c1 * c2 + cc * (c1 + c2)) / (out1 * out2)
    return 1 / (2 * math.pi * a1), a1 / (2 * math.pi * a2)
