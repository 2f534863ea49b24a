"""What the hand formulas of both op-amps of Table II's sizes share: bias, operating point of the pair, figures.

All transistors follow the square law with channel-length modulation, in saturation, bodies tied to sources. Functions
here are inner ones, unchecked: the bias is checked where it is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model.checks import real_number
from posfet_model.follower import ClosedLoop, close_loop
from posfet_model.paper import AMPLIFIER_SIZES, MOBILITY, STACK, THRESHOLD_VOLTAGE, TransistorSize
from posfet_model.transistor import Plane

HOLE_MOBILITY: Final = 283e-4
"""Mobility of the p-channel transistors [m2/(V s)], assumed: a third of the electrons'."""

SIZES: Final = {size.name: size for size in AMPLIFIER_SIZES}

_ITERATIONS: Final = 200
_TOLERANCE: Final = 1e-15  # relative


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


@dataclass(frozen=True, kw_only=True)
class OpAmpFigures:
    """What the hand formulas say of either op-amp, at rest with input and output near 0 V."""

    tail_current: float
    """Through M5 [A]."""
    overdrive: float
    """Vov of the input pair at balance [V]."""
    input_transconductance: float
    """gm1 [S]."""
    first_gain: float
    """gm1/(gds2 + gds4) [V/V]."""
    second_gain: float
    """Of what follows, M7 with its loads [V/V]."""
    dominant_pole: float
    """[Hz]"""
    second_pole: float
    """[Hz]"""
    slew_rate: float
    """Steepest rise of the output [V/s]."""

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
        """Gain and bandwidth of the follower, the second pole and a zero left out."""
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


def aspect(size: TransistorSize) -> float:
    """Return width over length [1]."""
    return size.width / size.length


def gate_capacitance(size: TransistorSize, capacitance: float) -> float:
    """Return the gate-source capacitance in saturation [F]: two thirds of the oxide's."""
    return 2 / 3 * size.width * size.length * capacitance


def output_capacitance(bias: AmplifierBias) -> float:
    """Return the capacitance [F] at the output of a follower, which drives the gate of M1 too.

    Half of that gate's charge is shared with M2 through the tail.
    """
    return bias.load_capacitance + 0.5 * gate_capacitance(SIZES["M1"], STACK.drive(Plane.GATE))


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


def _saturated(beta: float, overdrive: float, voltage: float, lam: float) -> float:
    """Return the drain current in saturation [A]."""
    return 0.5 * beta * overdrive**2 * (1 + lam * voltage)
