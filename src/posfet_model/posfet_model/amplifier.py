"""The two-stage Miller op-amp of Table II by hand formulas: from sizes and a bias to gain, poles, slew and offset.

    M1 (inverting), M2   POSFET input pair            M5, M6, M8  n-channel current mirror fed by the reference current
    M3, M4               p-channel mirror load        M7          p-channel second stage, Cc and Rz from gate to drain

All transistors follow the square law with channel-length modulation, in saturation, bodies tied to sources.
Formulas: Gray, Hurst, Lewis, Meyer, *Analysis and Design of Analog Integrated Circuits*, 5th ed., ch. 6 and 9; Allen
and Holberg, *CMOS Analog Circuit Design*, 3rd ed., sec. 6.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model.checks import instance, real_number
from posfet_model.follower import ClosedLoop, FollowerLimits, close_loop
from posfet_model.paper import AMPLIFIER_SIZES, MOBILITY, STACK, THRESHOLD_VOLTAGE, TransistorSize
from posfet_model.transistor import Plane

HOLE_MOBILITY: Final = 283e-4
"""Mobility of the p-channel transistors [m2/(V s)], assumed: a third of the electrons'."""

_ITERATIONS: Final = 200
_TOLERANCE: Final = 1e-15  # relative
SIZES: Final = {size.name: size for size in AMPLIFIER_SIZES}


@dataclass(frozen=True)
class AmplifierBias:
    """What Table II leaves open. The defaults are those of circuit B, fitted to 42.3 dB and 1.5 MHz, all assumed."""

    reference_current: float = 200e-6
    """Current into M6 [A], in [1e-9, 0.1]."""
    supply: float = 5.0
    """Positive supply, and the negative one with the other sign [V], in [0.5, 100]."""
    compensation: float = 46.2e-12
    """Cc [F], in [1e-15, 1e-6]."""
    zero_resistor: float = 2631.0
    """Rz in series with Cc [ohm], in [0, 1e9]."""
    load_capacitance: float = 10e-12
    """From the output to ground, without the follower's own input [F], in [0, 1e-6]."""
    load_resistance: float = 11e3
    """From the output to ground [ohm], in [1, 1e15]."""
    modulation: float = 0.1
    """Channel-length modulation lambda of all transistors [1/V], in [1e-6, 1]."""
    threshold: float = THRESHOLD_VOLTAGE.value
    """Vth of the n-channel and -Vth of the p-channel transistors [V], in [0, 10]."""

    def __post_init__(self) -> None:
        real_number("reference_current", self.reference_current, 1e-9, 0.1)
        real_number("supply", self.supply, 0.5, 100)
        real_number("compensation", self.compensation, 1e-15, 1e-6)
        real_number("zero_resistor", self.zero_resistor, 0, 1e9)
        real_number("load_capacitance", self.load_capacitance, 0, 1e-6)
        real_number("load_resistance", self.load_resistance, 1, 1e15)
        real_number("modulation", self.modulation, 1e-6, 1)
        real_number("threshold", self.threshold, 0, 10)


@dataclass(frozen=True)
class AmplifierFigures:
    """What the hand formulas say, at rest with input and output near 0 V."""

    tail_current: float
    """Through M5 [A]."""
    output_current: float
    """Through M7 [A]."""
    overdrive: float
    """Vov of the input pair at balance [V]."""
    input_transconductance: float
    """gm1 [S]."""
    load_transconductance: float
    """gm3 [S]."""
    first_gain: float
    """gm1/(gds2 + gds4) [V/V]."""
    second_gain: float
    """gm7/(gds7 + gds8 + 1/RL) [V/V]."""
    dominant_pole: float
    """[Hz]"""
    second_pole: float
    """[Hz]"""
    zero: float
    """1/(2*pi*Cc*(Rz - 1/gm7)) [Hz], positive in the left half-plane; inf when it is cancelled."""
    slew_rate: float
    """Steepest rise of the output [V/s], tail current over Cc."""
    falling_slew_rate: float
    """Steepest fall [V/s], with what M8 can sink near 0 V, at most `slew_rate`. A steeper fall cuts M7 off and ends in
    an overshoot that no model here follows."""
    bend: float
    """By how much less than linear the gate of M7 moves when all of the tail current arrives [V], as the output sees
    it: the output of a follower runs ahead by that when it slews up."""
    systematic_offset: float
    """Output of the follower with its input at 0 V and equal pairs [V]."""
    limits: FollowerLimits
    """Inputs between which all transistors stay saturated, the lower slew rate, the second pole as last frequency."""

    @property
    def open_loop_gain(self) -> float:
        """A0 [V/V]."""
        return self.first_gain * self.second_gain

    @property
    def gain_bandwidth(self) -> float:
        """A0 times the dominant pole [Hz]."""
        return self.open_loop_gain * self.dominant_pole

    @property
    def slew_overdrive(self) -> float:
        """Overdrive [V] with which a square-law pair of this gain-bandwidth product has this slew rate."""
        return self.slew_rate / (2 * math.pi * self.gain_bandwidth)

    @property
    def closed_loop(self) -> ClosedLoop:
        """Gain and bandwidth of the follower, the second pole and the zero left out."""
        return close_loop(self.open_loop_gain, self.gain_bandwidth)


@dataclass(frozen=True)
class OperatingPoint:
    """Operating point: overdrives, currents [A] and drain-source voltages [V]."""

    tail: float
    pair_overdrive: float
    pair_voltage: float
    load_overdrive: float
    load_voltage: float
    bias_overdrive: float
    output: float
    """Current of M7 and M8 with the output at 0 V, where the load resistor takes none."""
    output_overdrive: float
    """Of M7 at that current."""


def figures_of_merit(bias: AmplifierBias | None = None) -> AmplifierFigures:
    """Return gain, poles, offset and slew of the op-amp of Table II.

    Raises ValueError when the supply is too low for the transistors to be saturated.

    Notes
    -----
    Against ngspice with the defaults (circuit B): open-loop gain +1.6 %, dominant pole +2.3 %, offset 2.42 for 2.45 mV.
    The poles are those of the two-node circuit, ``p1 = 1/a1`` and ``p2 = a1/a2``, valid while p2 is well above
    p1; the second gain is only about 4.3 here, so the usual ``gm1/Cc`` and ``I/Cc`` are too high by a quarter.
    While the output slews up, M7 carries the tail current too, so gm7 and the second gain are those of that current;
    ngspice slews at 4.85 V/us where this gives 4.49.
    """
    bias = AmplifierBias() if bias is None else instance("bias", bias, AmplifierBias)
    point = operating_point(bias)
    lam = bias.modulation
    gm1, gm3 = point.tail / point.pair_overdrive, point.tail / point.load_overdrive
    half = point.tail / 2
    out1 = lam * half / (1 + lam * point.pair_voltage) + lam * half / (1 + lam * point.load_voltage)
    gm7 = 2 * point.output / point.output_overdrive
    out2 = 2 * lam * point.output / (1 + lam * bias.supply) + 1 / bias.load_resistance
    first_gain, second_gain = gm1 / out1, gm7 / out2
    p1, p2 = _poles(bias, out1, out2, gm7)
    lead = bias.compensation * (bias.zero_resistor - 1 / gm7)
    loaded = math.sqrt(1 + point.tail / point.output)  # gm7 in slewing over gm7 at rest
    slew_rate = point.tail / (bias.compensation * (1 + 1 / (second_gain * loaded)))
    sinking = bias.compensation * (1 + 1 / second_gain) + output_capacitance(bias)
    falling = min(slew_rate, point.output / sinking)
    moved = point.output_overdrive * (point.tail / point.output) / (1 + loaded)  # overdrive of M7 in slewing less rest
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
        slew_rate=slew_rate,
        falling_slew_rate=falling,
        bend=0.5 * moved**2 / point.output_overdrive / (1 + 1 / (second_gain * loaded)),
        systematic_offset=(point.load_overdrive - point.output_overdrive) / first_gain,
        limits=FollowerLimits(
            v_low=max(
                -bias.supply + point.bias_overdrive + bias.threshold + point.pair_overdrive,
                -point.output * bias.load_resistance,  # M8 cannot draw more through the load
            ),
            v_high=bias.supply - max(point.load_overdrive, point.output_overdrive),
            slew_rate=falling,
            frequency=p2,
        ),
    )


def mismatch_offset(
    figures: AmplifierFigures,
    pair_threshold: float,
    load_threshold: float,
    pair_size: float,
    load_size: float,
) -> float:
    """Return the input offset [V] that small differences between the two sides make.

    ``dV = dVth1 + gm3/gm1*dVth3 + Vov/2*(dbeta1/beta1 + dbeta3/beta3)``, first order of the pair's square law, with
    signs such that each term adds. For standard deviations of independent differences add the terms' squares.

    Parameters
    ----------
    figures : of the amplifier.
    pair_threshold, load_threshold : differences of threshold of M1, M2 and of M3, M4 [V], within +-1.
    pair_size, load_size : relative differences of gain factor [1], within +-0.5.
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


def aspect(size: TransistorSize) -> float:
    """Return width over length [1]."""
    return size.width / size.length


def gate_capacitance(size: TransistorSize, capacitance: float) -> float:
    """Return the gate-source capacitance in saturation [F]: two thirds of the oxide's."""
    return 2 / 3 * size.width * size.length * capacitance


def _saturated(beta: float, overdrive: float, voltage: float, lam: float) -> float:
    """Return the drain current in saturation [A]."""
    return 0.5 * beta * overdrive**2 * (1 + lam * voltage)


def operating_point(bias: AmplifierBias) -> OperatingPoint:
    """Return the currents and voltages at balance, by fixed-point iteration of the square laws."""
    lam, vth, supply = bias.modulation, bias.threshold, bias.supply
    beta_n = {name: MOBILITY.value * STACK.oxide * aspect(SIZES[name]) for name in ("M5", "M6", "M8")}
    beta_p = {name: HOLE_MOBILITY * STACK.oxide * aspect(SIZES[name]) for name in ("M3", "M7")}
    beta1 = MOBILITY.value * STACK.drive(Plane.GATE) * aspect(SIZES["M1"])
    bias_overdrive = pair_overdrive = load_overdrive = 0.5
    for _ in range(_ITERATIONS):
        before = (bias_overdrive, pair_overdrive, load_overdrive)
        bias_overdrive = math.sqrt(2 * bias.reference_current / (beta_n["M6"] * (1 + lam * (vth + bias_overdrive))))
        tail_voltage = supply - vth - pair_overdrive
        load_voltage = vth + load_overdrive
        pair_voltage = supply - load_voltage + vth + pair_overdrive
        if tail_voltage < bias_overdrive or load_voltage > supply:
            raise ValueError(f"supply must keep every transistor saturated, got {supply:g} V")
        tail = _saturated(beta_n["M5"], bias_overdrive, tail_voltage, lam)
        pair_overdrive = math.sqrt(tail / (beta1 * (1 + lam * pair_voltage)))
        load_overdrive = math.sqrt(tail / (beta_p["M3"] * (1 + lam * load_voltage)))
        after = (bias_overdrive, pair_overdrive, load_overdrive)
        change = max(abs(a / b - 1) for a, b in zip(before, after, strict=True))
        if change < _TOLERANCE:
            break
    output = _saturated(beta_n["M8"], bias_overdrive, supply, lam)
    return OperatingPoint(
        tail=tail,
        pair_overdrive=pair_overdrive,
        pair_voltage=pair_voltage,
        load_overdrive=load_overdrive,
        load_voltage=load_voltage,
        bias_overdrive=bias_overdrive,
        output=output,
        output_overdrive=math.sqrt(2 * output / (beta_p["M7"] * (1 + lam * supply))),
    )


def output_capacitance(bias: AmplifierBias) -> float:
    """Return the capacitance [F] at the output of a follower, which drives the gate of M1 too.

    Half of that gate's charge is shared with M2 through the tail.
    """
    return bias.load_capacitance + 0.5 * gate_capacitance(SIZES["M1"], STACK.drive(Plane.GATE))


def _poles(bias: AmplifierBias, out1: float, out2: float, gm7: float) -> tuple[float, float]:
    """Return both poles [Hz] of the two nodes with conductances out1, out2 [S], coupled by Cc."""
    c1 = gate_capacitance(SIZES["M7"], STACK.oxide)
    c2 = output_capacitance(bias)
    cc = bias.compensation
    a1 = (c1 + cc) / out1 + (c2 + cc) / out2 + gm7 * cc / (out1 * out2)
    a2 = (c1 * c2 + cc * (c1 + c2)) / (out1 * out2)
    return 1 / (2 * math.pi * a1), a1 / (2 * math.pi * a2)
