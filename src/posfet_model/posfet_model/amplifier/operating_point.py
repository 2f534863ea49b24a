# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Hand formulas common to both op-amps: sizes and process, bias, operating point of the pair, figures of merit.

All transistors follow the square law with channel-length modulation, in saturation, bodies tied to sources. Functions
here are internal and unchecked: design and bias are checked when they are created.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Final, TypeVar

from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.closed_loop import ClosedLoop, FollowerLimits, close_loop
from posfet_model.device.paper import AMPLIFIER_SIZES, MOBILITY, STACK, THRESHOLD_VOLTAGE, TransistorSize
from posfet_model.device.transistor import Plane, Stack

HOLE_MOBILITY: Final = 283e-4
"""Mobility of the p-channel transistors [m2/(V s)], assumed: a third of the electrons'."""

MIN_OUTPUT_CURRENT: Final = 0.05
"""Minimum current of M7 relative to that at rest [1], assumed: in ngspice circuit B oscillates at 2 %."""

LARGEST_SHIFT: Final = 100.0
"""Largest accepted difference between the threshold of M1 and M2 and that of the other transistors [V]."""

_NAMES: Final = ("M1", "M2", "M3", "M4", "M5", "M6", "M7", "M8")
_PAIRS: Final = (("M1", "M2"), ("M3", "M4"))
_ITERATIONS: Final = 200
_TOLERANCE: Final = 1e-15  # relative
_HALVINGS: Final = 60


@dataclass(frozen=True)
class AmplifierDesign:
    """Sizes of the transistors M1 to M8, and the process. The defaults are the paper's."""

    sizes: tuple[TransistorSize, ...] = AMPLIFIER_SIZES
    """M1 to M8, one of each name; M1 equal to M2, M3 equal to M4."""
    stack: Stack = STACK
    """Film and oxide: the gates of the pair M1, M2 act through both, those of the others through the oxide alone."""
    electron_mobility: float = MOBILITY.value
    """Mobility of the n-channel transistors [m2/(V s)], in [1e-9, 100]."""
    hole_mobility: float = HOLE_MOBILITY
    """Mobility of the p-channel transistors [m2/(V s)], in [1e-9, 100]."""
    pair_threshold_shift: float = 0.0
    """Threshold of M1 and M2 less that of the other transistors [V], by poling of the film, within +-100."""

    def __post_init__(self) -> None:
        names = [instance("sizes", size, TransistorSize).name for size in instance("sizes", self.sizes, tuple)]
        if sorted(names) != list(_NAMES):
            raise ValueError(f"sizes must be one each of {', '.join(_NAMES)}, got {', '.join(names) or 'none'}")
        for one, other in _PAIRS:
            if self.aspect(one) != self.aspect(other) or self.size(one).length != self.size(other).length:
                raise ValueError(f"sizes must have {one} like {other}, got {self.size(one)} and {self.size(other)}")
        instance("stack", self.stack, Stack)
        real_number("electron_mobility", self.electron_mobility, 1e-9, 100)
        real_number("hole_mobility", self.hole_mobility, 1e-9, 100)
        real_number("pair_threshold_shift", self.pair_threshold_shift, -LARGEST_SHIFT, LARGEST_SHIFT)

    def size(self, name: str) -> TransistorSize:
        """Return the size of a transistor by its name; unchecked."""
        return next(size for size in self.sizes if size.name == name)

    def aspect(self, name: str) -> float:
        """Return width over length [1] of a transistor; unchecked."""
        return self.size(name).width / self.size(name).length

    def pair_factor(self) -> float:
        """Return the gain factor [A/V2] of M1 and M2, their gates on the film."""
        return self.electron_mobility * self.stack.drive(Plane.GATE) * self.aspect("M1")

    def n_factor(self, name: str) -> float:
        """Return the gain factor [A/V2] of an n-channel transistor on the oxide alone; unchecked."""
        return self.electron_mobility * self.stack.oxide * self.aspect(name)

    def p_factor(self, name: str) -> float:
        """Return the gain factor [A/V2] of a p-channel transistor on the oxide alone; unchecked."""
        return self.hole_mobility * self.stack.oxide * self.aspect(name)

    def gate_capacitance(self, name: str, plane: Plane = Plane.OXIDE) -> float:
        """Return the gate-source capacitance in saturation [F], two thirds of the whole; unchecked.

        Parameters
        ----------
        name : str
            Name of the transistor, as in Table II.
        plane : Plane, optional
            Plane at which the capacitance per area counts.
        """
        return 2 / 3 * self.size(name).width * self.size(name).length * self.stack.drive(plane)

    def output_capacitance(self, load: float) -> float:
        """Return the capacitance [F] at the output of a follower: the `load` [F] and the gate of M1.

        Half of that gate's charge is shared with M2 through the tail. Unchecked.

        Parameters
        ----------
        load : float
            Load capacitance [F].
        """
        return load + 0.5 * self.gate_capacitance("M1", Plane.GATE)


TABLE_II: Final = AmplifierDesign()
"""The paper's amplifier."""


@dataclass(frozen=True)
class AmplifierBias:
    """Parameters not in Table II. The defaults are those of circuit B, fitted to 42.3 dB and 1.5 MHz, all assumed."""

    reference_current: float = 200e-6
    """Current into M6 [A], in [1e-9, 0.1]."""
    supply: float = 5.0
    """Positive supply, and magnitude of the negative one [V], in [0.5, 100]."""
    compensation: float = 46.2e-12
    """Compensation capacitor Cc [F], in [1e-15, 1e-6]."""
    zero_resistor: float = 2631.0
    """Rz in series with Cc [ohm], in [0, 1e9]."""
    load_capacitance: float = 10e-12
    """Capacitance from the output to ground, without the follower's own input [F], in [0, 1e-6]."""
    load_resistance: float = 11e3
    """Resistance from the output to ground [ohm], in [1, 1e15]."""
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


CIRCUIT_B: Final = AmplifierBias()
"""Bias of circuit B, two stages."""


_Figures = TypeVar("_Figures", bound="OpAmpFigures")


class NotSaturatedError(ValueError):
    """A transistor cannot be saturated: there is no operating point of which the hand formulas could be."""


@dataclass(frozen=True, kw_only=True)
class OpAmpFigures:
    """Figures of merit of either op-amp by hand formulas, at rest with input and output near 0 V."""

    tail_current: float
    """Current through M5 [A]."""
    overdrive: float
    """Vov of the input pair at balance [V]."""
    input_transconductance: float
    """gm1 [S]."""
    first_gain: float
    """gm1/(gds2 + gds4) [V/V]."""
    second_gain: float
    """Gain of the stage of M7 with its loads [V/V]."""
    dominant_pole: float
    """Frequency of the dominant pole [Hz]."""
    second_pole: float
    """Frequency of the second pole [Hz]."""
    slew_rate: float
    """Steepest rise of the output [V/s]."""
    limits: FollowerLimits | None
    """Input range in which all transistors stay saturated, slew rates, and the second pole as highest frequency; None
    where a transistor cannot saturate."""
    reasons: tuple[str, ...] = ()
    """Why there are no figures: all are NaN where a transistor cannot saturate; empty otherwise."""

    @classmethod
    def unknown(cls: type[_Figures], error: NotSaturatedError) -> _Figures:
        """Return figures that are all NaN, with the reason; unchecked."""
        names = (item.name for item in fields(cls) if item.name not in ("limits", "reasons"))
        return cls(**dict.fromkeys(names, math.nan), limits=None, reasons=(str(error),))

    def known_limits(self) -> FollowerLimits:
        """Return the limits.

        Returns
        -------
        FollowerLimits
            The limits.

        Raises
        ------
        ValueError
            A transistor cannot saturate.
        """
        if self.limits is None:
            raise ValueError("; ".join(self.reasons))
        return self.limits

    @property
    def open_loop_gain(self) -> float:
        """Open-loop gain A0 [V/V]."""
        return self.first_gain * self.second_gain

    @property
    def gain_bandwidth(self) -> float:
        """Gain-bandwidth product: A0 times the dominant pole [Hz]."""
        return self.open_loop_gain * self.dominant_pole

    @property
    def slew_overdrive(self) -> float:
        """Overdrive [V] at which a square-law pair of this gain-bandwidth product has this slew rate."""
        return self.slew_rate / (2 * math.pi * self.gain_bandwidth)

    @property
    def closed_loop(self) -> ClosedLoop:
        """Gain and bandwidth of the follower, without the second pole and a zero."""
        return close_loop(self.open_loop_gain, self.gain_bandwidth)


@dataclass(frozen=True)
class OperatingPoint:
    """Operating point: overdrives, currents [A] and drain-source voltages [V]."""

    tail: float
    pair_threshold: float
    pair_overdrive: float
    pair_voltage: float
    load_overdrive: float
    load_voltage: float
    bias_overdrive: float
    output: float
    """Current of M7 and M8 with the output at 0 V, where the load resistor carries none [A]."""
    output_overdrive: float
    """Overdrive of M7 at that current [V]."""

    def output_demand(self, bias: AmplifierBias, volts: float) -> float:
        """Return the current [A] that M7 has to carry at an output voltage: that of M8 and the load; unchecked.

        Parameters
        ----------
        bias : AmplifierBias
            Bias of the op-amp.
        volts : float
            Output voltage [V].
        """
        sunk = self.output * (1 + bias.modulation * volts / (1 + bias.modulation * bias.supply))
        return sunk + volts / bias.load_resistance


def operating_point(bias: AmplifierBias, design: AmplifierDesign) -> OperatingPoint:
    """Return the currents and voltages at balance, by fixed-point iteration of the square laws.

    Parameters
    ----------
    bias : AmplifierBias
        Bias of the circuit.
    design : AmplifierDesign
        Sizes and process.

    Returns
    -------
    OperatingPoint
        Overdrives, currents and voltages.

    Raises
    ------
    NotSaturatedError
        The supply is too low for the transistors to be saturated.
    """
    lam, vth, supply = bias.modulation, bias.threshold, bias.supply
    pair_threshold = vth + design.pair_threshold_shift
    mirror, load = design.n_factor("M6"), design.p_factor("M3")
    bias_overdrive = pair_overdrive = load_overdrive = 0.5
    for _ in range(_ITERATIONS):
        before = (bias_overdrive, pair_overdrive, load_overdrive)
        bias_overdrive = math.sqrt(2 * bias.reference_current / (mirror * (1 + lam * (vth + bias_overdrive))))
        tail_voltage = supply - pair_threshold - pair_overdrive
        load_voltage = vth + load_overdrive
        pair_voltage = supply - load_voltage + pair_threshold + pair_overdrive
        if tail_voltage < bias_overdrive or load_voltage > supply or pair_voltage < pair_overdrive:
            raise NotSaturatedError(f"supply must keep every transistor saturated, got {supply:g} V")
        tail = saturated(design.n_factor("M5"), bias_overdrive, tail_voltage, lam)
        pair_overdrive = math.sqrt(tail / (design.pair_factor() * (1 + lam * pair_voltage)))
        load_overdrive = math.sqrt(tail / (load * (1 + lam * load_voltage)))
        after = (bias_overdrive, pair_overdrive, load_overdrive)
        change = max(abs(a / b - 1) for a, b in zip(before, after, strict=True))
        if change < _TOLERANCE:
            break
    output = saturated(design.n_factor("M8"), bias_overdrive, supply, lam)
    return OperatingPoint(
        tail=tail,
        pair_threshold=pair_threshold,
        pair_overdrive=pair_overdrive,
        pair_voltage=pair_voltage,
        load_overdrive=load_overdrive,
        load_voltage=load_voltage,
        bias_overdrive=bias_overdrive,
        output=output,
        output_overdrive=math.sqrt(2 * output / (design.p_factor("M7") * (1 + lam * supply))),
    )


def lowest_input(bias: AmplifierBias, point: OperatingPoint) -> float:
    """Return the lowest input [V] that keeps M5 and M8 saturated and leaves M7 its minimum current.

    Parameters
    ----------
    bias : AmplifierBias
        Bias of the circuit.
    point : OperatingPoint
        Operating point at balance.

    Returns
    -------
    float
        Input voltage [V].
    """
    tail = -bias.supply + point.bias_overdrive + point.pair_threshold + point.pair_overdrive
    least = MIN_OUTPUT_CURRENT * point.output
    return max(tail, bisect(lambda volts: point.output_demand(bias, volts) - least, -bias.supply, 0.0))


def bisect(rising: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of a rising function by bisection.

    Parameters
    ----------
    rising : callable
        The function.
    low, high : float
        Bracket of the zero.

    Returns
    -------
    float
        Position of the zero; an end of the bracket where there is none.
    """
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if rising(middle) < 0:
            low = middle
        else:
            high = middle
    return high


def saturated(beta: float, overdrive: float, voltage: float, lam: float) -> float:
    """Return the drain current in saturation [A].

    Parameters
    ----------
    beta : float
        Gain factor [A/V2].
    overdrive, voltage : float
        Overdrive and drain-source voltage [V].
    lam : float
        Channel-length modulation lambda [1/V].

    Returns
    -------
    float
        Drain current [A].
    """
    return 0.5 * beta * overdrive**2 * (1 + lam * voltage)
