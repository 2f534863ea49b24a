"""The whole sensor element as one object: film, transistor, poling, bias, amplifier, load, ADC and band.

Every number may be an array: arrays broadcast, so that one object is a single design, a sweep, or a tolerance analysis.
What follows from the numbers is in `AmplifierFigures`, `NoiseBudget` and the properties here; `report` lists it all.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from posfet_model._lib.types import Array, FloatArray
from posfet_model._lib.validation import whole_number
from posfet_model.amplifier.calibration import calibrate_circuit
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import circuit_figures
from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.operating_point import AmplifierBias, AmplifierDesign
from posfet_model.amplifier.ringing_follower import RingingFollower
from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.amplifier.validity import Validity
from posfet_model.design import readout
from posfet_model.design.amplifier_figures import AmplifierFigures, amplifier_figures
from posfet_model.device import paper
from posfet_model.device.noise import (
    NoiseBudget,
    gate_flicker_coefficient,
    noise_budget,
    pair_density,
    sampling_rms,
)
from posfet_model.device.paper import TransistorSize
from posfet_model.device.taxel import Taxel, Values, plausible_fields, quantity
from posfet_model.device.transistor import Stack
from posfet_model.spice import netlist
from posfet_model.spice.circuits import Circuit

PARTS = ("gate", "gate", "load", "load", "tail", "mirror", "output", "sink")
"""Names of M1 to M8 in the fields of sizes."""

LEAST_TRANSCONDUCTANCE = 1e-12
"""gm1 below which the input pair is cut off, and the noise unknown [S]."""

LEAST_GAIN = 1e-3
"""Gain of the follower below which the noise behind it is unknown [V/V]."""

NOT_POLED = "the film is not poled: a force gives no signal"
BEYOND_INPUT = "the force to be measured drives the input out of the amplifier's range"
BEYOND_ADC = "the force to be measured drives the ADC out of its range"
TOO_STEEP = "the force to be measured, at the upper end of the band, is steeper than the slew rate"


@dataclass(frozen=True, kw_only=True, eq=False)
class PosfetDesign(Taxel):
    """A sensor element from the film to the ADC, or many: any number may be an array.

    The defaults are the paper's device with the bias of circuit B (docs/device.md); M1 and M2 have the size of the
    transistor below the film, `gate_width` and `gate_length`.

    Raises
    ------
    ValueError
        A value is not a real number, not plausible in its SI unit, or the shapes of arrays do not broadcast.

    Examples
    --------
    >>> design = PosfetDesign()
    >>> print(f"{design.amplifier.gain_db:.1f} dB, {design.amplifier.gain_pole_product / 1e6:.2f} MHz")
    52.5 dB, 4.90 MHz
    >>> thicker = PosfetDesign(film_thickness=np.array([2.5e-6, 5e-6]))
    >>> print((thicker.smallest_force * 1e6).round())
    [167.  88.]
    """

    stages: int = 2
    """2: Miller op-amp, two stages; 1: one stage and an n-channel output follower."""
    reference_current: Values = quantity(readout.REFERENCE_CURRENT, 1e-9, 0.1)
    """Current into M6 [A]."""
    supply: Values = quantity(readout.SUPPLY, 0.5, 100)
    """Positive supply, and magnitude of the negative one [V]."""
    compensation: Values = quantity(readout.COMPENSATION, 1e-15, 1e-6)
    """Compensation capacitor Cc [F]."""
    zero_resistor: Values = quantity(readout.ZERO_RESISTOR, 0, 1e9)
    """Rz in series with Cc [ohm]; not used with one stage."""
    load_capacitance: Values = quantity(readout.LOAD_CAPACITANCE, 0, 1e-6)
    """Capacitance from the output to ground [F]."""
    load_resistance: Values = quantity(readout.LOAD_RESISTANCE, 1, 1e15)
    """Resistance from the output to ground [ohm]."""
    channel_length_modulation: Values = quantity(readout.MODULATION, 1e-6, 1)
    """lambda of all transistors [1/V]."""
    hole_mobility: Values = quantity(readout.HOLES, 1e-5, 1)
    """Mobility of the p-channel transistors [m2/(V s)]."""
    load_width: Values = quantity(readout.LOAD_WIDTH, 1e-8, 0.1)
    """Width of M3 and M4 [m]."""
    load_length: Values = quantity(readout.LOAD_LENGTH, 1e-8, 1e-2)
    """Length of M3 and M4 [m]."""
    tail_width: Values = quantity(readout.TAIL_WIDTH, 1e-8, 0.1)
    """Width of M5 [m]."""
    tail_length: Values = quantity(readout.TAIL_LENGTH, 1e-8, 1e-2)
    """Length of M5 [m]."""
    mirror_width: Values = quantity(readout.MIRROR_WIDTH, 1e-8, 0.1)
    """Width of M6 [m]."""
    mirror_length: Values = quantity(readout.MIRROR_LENGTH, 1e-8, 1e-2)
    """Length of M6 [m]."""
    output_width: Values = quantity(readout.OUTPUT_WIDTH, 1e-8, 0.1)
    """Width of M7 [m]."""
    output_length: Values = quantity(readout.OUTPUT_LENGTH, 1e-8, 1e-2)
    """Length of M7 [m]."""
    sink_width: Values = quantity(readout.SINK_WIDTH, 1e-8, 0.1)
    """Width of M8 [m]."""
    sink_length: Values = quantity(readout.SINK_LENGTH, 1e-8, 1e-2)
    """Length of M8 [m]."""
    flicker_constant: Values = quantity(paper.FLICKER_CONSTANT, 0, 1e-15)
    """1/f noise of the process, K*W*L*Cox [V2 F]."""
    temperature: Values = quantity(paper.TEMPERATURE, 100, 600)
    """Temperature of the chip [K]."""
    adc_bits: Values = quantity(readout.ADC_BITS, 1, 32)
    """Resolution of the ADC [bit]."""
    adc_low: Values = quantity(readout.ADC_LOW, 0, 1e3, signed=True)
    """Lower end of the ADC's range [V]."""
    adc_high: Values = quantity(readout.ADC_HIGH, 0, 1e3, signed=True)
    """Upper end of the ADC's range [V]."""
    sampling_capacitance: Values = quantity(readout.SAMPLING_CAPACITANCE, 1e-15, 1e-6)
    """Sampling capacitor of the ADC [F]."""
    low_frequency: Values = quantity(readout.LOW_FREQUENCY, 1e-9, 1e9)
    """Lower end of the band in which noise counts [Hz]."""
    high_frequency: Values = quantity(readout.HIGH_FREQUENCY, 1e-6, 1e12)
    """Upper end of that band [Hz]."""
    signal_force: Values = quantity(readout.SIGNAL_FORCE, 1e-9, 1e5)
    """Force to which the signal-to-noise ratio refers, and which has to be measured [N]."""
    detection_sigmas: Values = quantity(readout.DETECTION_SIGMAS, 1e-3, 100)
    """Standard deviations of the noise in the smallest detectable force [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("stages", self.stages, 1, 2)
        for low, high in (("adc_low", "adc_high"), ("low_frequency", "high_frequency")):
            if np.any(np.less_equal(getattr(self, high), getattr(self, low))):
                raise ValueError(f"{high} must be above {low}, got {_first(self, high)} and {_first(self, low)}")

    @cached_property
    def amplifier(self) -> AmplifierFigures:
        """Figures of merit of the op-amp and its follower; NaN where it has no operating point."""
        return amplifier_figures(self.op_amp)

    @cached_property
    def op_amp(self) -> AmplifierCircuit:
        """The op-amp as a circuit, of arrays where the design has them."""
        second = self.hole_mobility if self.stages == 2 else self.electron_mobility  # M7
        n, p, below = self.electron_mobility, self.hole_mobility, self.coupling
        mobility = (n, n, p, p, n, n, second, n)
        drive = np.asarray(self.oxide_capacitance)[..., None] * _each(below, below, 1, 1, 1, 1, 1, 1)
        width, length = (_each(*(getattr(self, f"{part}_{size}") for part in PARTS)) for size in ("width", "length"))
        plain = self.threshold_voltage
        return AmplifierCircuit(
            stages=self.stages,
            beta=_each(*mobility) * drive * width / length,
            gate_area=drive * width * length,
            threshold=_each(self.threshold, self.threshold, *(plain,) * 6),
            modulation=np.asarray(self.channel_length_modulation),
            supply=np.asarray(self.supply),
            reference_current=np.asarray(self.reference_current),
            compensation=np.asarray(self.compensation),
            zero_resistor=np.asarray(self.zero_resistor),
            load_resistance=np.asarray(self.load_resistance),
            load_capacitance=np.asarray(self.load_capacitance),
        )

    @cached_property
    def noise(self) -> NoiseBudget:
        """Noise by source in the band [V rms], as a voltage of the top electrode."""
        amplifier = self.amplifier
        usable = amplifier.found & (amplifier.input_transconductance >= LEAST_TRANSCONDUCTANCE)
        usable &= (amplifier.follower_gain >= LEAST_GAIN) & (amplifier.follower_gain <= 1 / LEAST_GAIN)
        # Where it is not, the rest is computed with figures that do not matter.
        gm1 = np.where(usable, amplifier.input_transconductance, 1.0)
        gm3 = np.where(usable, amplifier.load_transconductance, 0.0)
        gain = np.where(usable, amplifier.follower_gain, 1.0)
        below = gate_flicker_coefficient(
            self.flicker_constant, self.gate_width, self.gate_length, self.oxide_capacitance
        )
        load = gate_flicker_coefficient(
            self.flicker_constant, self.load_width, self.load_length, self.oxide_capacitance
        )
        budget = noise_budget(
            self.bias_noise(self.low_frequency, self.high_frequency, self.temperature),
            pair_density(gm1, gm3, self.temperature),
            2 * (below / self.coupling**2 + load * (gm3 / gm1) ** 2),
            self.lsb,
            np.abs(self.volts_per_newton()),
            self.low_frequency,
            self.high_frequency,
            gain=gain,
            sampled_rms=sampling_rms(self.sampling_capacitance, self.temperature),
        )
        ahead = ("thermal", "flicker", "sampling", "quantisation")
        return dataclasses.replace(
            budget, **{name: np.where(usable, getattr(budget, name), math.nan)[()] for name in ahead}
        )

    @property
    def lsb(self) -> FloatArray:
        """Step of the ADC [V]."""
        step: FloatArray = np.subtract(self.adc_high, self.adc_low) / (np.exp2(self.adc_bits) - 1)
        return step

    @property
    def signal_to_noise(self) -> FloatArray:
        """Ratio of the signal of `signal_force` to the noise in the band [dB]."""
        return self.noise.signal_to_noise(self.signal_force)

    @property
    def smallest_force(self) -> FloatArray:
        """Smallest detectable force [N]; inf where a force gives no signal."""
        return self.noise.minimum_force(1.0) * self.detection_sigmas

    @property
    def output_volts_per_newton(self) -> FloatArray:
        """Sensitivity at the follower's output [V/N]."""
        return self.volts_per_newton() * self.amplifier.follower_gain

    @property
    def amperes_per_newton(self) -> FloatArray:
        """Change of the drain current of M1 per force at the bias of the pair [A/N]: gm1 times V/N, of either plane."""
        return self.amplifier.input_transconductance * self.volts_per_newton()

    @property
    def low_corner(self) -> FloatArray:
        """Frequency below which the signal leaks away, 1/(2*pi*R*(Cf + Cg)) [Hz]."""
        return 1 / (2 * math.pi * self.leak_time_constant)

    @property
    def largest_force(self) -> FloatArray:
        """Largest compressive force within the ranges of amplifier and ADC [N]; inf where a force gives no signal."""
        return np.minimum(self._reach("amplifier"), self._reach("adc"))[()]

    def _reach(self, of: str) -> FloatArray:
        """Return the force [N] that reaches the end of the input range of the amplifier or of the ADC behind it."""
        gain = self.amplifier.follower_gain
        per_newton = self.volts_per_newton()
        with np.errstate(divide="ignore", invalid="ignore"):  # of a follower without gain, a film without signal
            low, high = {
                "amplifier": (self.amplifier.lowest_input, self.amplifier.highest_input),
                "adc": (self.adc_low / gain, self.adc_high / gain),
            }[of]
            force = np.where(per_newton > 0, high, low) / per_newton
        return np.where(per_newton == 0, math.inf, force)

    @property
    def power(self) -> FloatArray:
        """Power from both supplies at rest [W]."""
        watts: FloatArray = 2 * np.asarray(self.supply) * self.amplifier.supply_current
        return watts

    @property
    def area(self) -> FloatArray:
        """Area of the film and of the gates of M2 to M8, without wiring and capacitors [m2]."""
        gates = (np.multiply(getattr(self, f"{part}_width"), getattr(self, f"{part}_length")) for part in PARTS[1:])
        total: FloatArray = sum(gates, np.asarray(self.film_area))
        return total

    @cached_property
    def validity(self) -> Validity:
        """Where the design is usable, and why not: ringing, transistors out of saturation, ranges, slew rate."""
        volts = np.abs(self.volts_per_newton() * self.signal_force)
        with np.errstate(invalid="ignore"):
            return self.amplifier.validity.also(
                {
                    NOT_POLED: np.equal(volts, 0),
                    BEYOND_INPUT: np.greater(self.signal_force, self._reach("amplifier")),
                    BEYOND_ADC: np.greater(self.signal_force, self._reach("adc")),
                    TOO_STEEP: 2 * math.pi * self.high_frequency * volts
                    > np.minimum(self.amplifier.slew_rate, self.amplifier.falling_slew_rate),
                }
            )

    @property
    def valid(self) -> Any:
        """Whether the design is usable; a mask for arrays."""
        return np.broadcast_to(self.validity.valid, self.shape)[()]

    @property
    def reasons(self) -> list[str]:
        """Why the design, or any of the arrays, is not valid; empty if it is."""
        return self.validity.reasons

    def at(self, *index: int) -> PosfetDesign:
        """Return one design of the arrays.

        Parameters
        ----------
        *index : int
            Position in `shape`.

        Returns
        -------
        PosfetDesign
            A design of numbers.
        """
        chosen: dict[str, Any] = {
            name: float(np.broadcast_to(getattr(self, name), self.shape)[index]) for name in plausible_fields(self)
        }
        if self.poling_voltages is not None:
            chosen["poling_voltages"] = tuple(
                float(np.broadcast_to(volt, self.shape)[index]) for volt in self.poling_voltages
            )
        return dataclasses.replace(self, **chosen)

    def circuit(self, name: str = "design") -> Circuit:
        """Return the circuit of a single design, for hand formulas and SPICE.

        Parameters
        ----------
        name : str, default "design"
            Name of the circuit, of letters, digits and underscores.

        Returns
        -------
        Circuit
            The circuit.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), or the name has other characters.
        """
        self._require_single()
        return Circuit(
            name,
            self.stages,
            AmplifierBias(
                reference_current=float(self.reference_current),
                supply=float(self.supply),
                compensation=float(self.compensation),
                zero_resistor=float(self.zero_resistor),
                load_capacitance=float(self.load_capacitance),
                load_resistance=float(self.load_resistance),
                modulation=float(self.channel_length_modulation),
                threshold=float(self.threshold_voltage),
            ),
            AmplifierDesign(
                sizes=tuple(
                    TransistorSize(
                        f"M{m}", float(getattr(self, f"{part}_width")), float(getattr(self, f"{part}_length"))
                    )
                    for m, part in enumerate(PARTS, 1)
                ),
                stack=Stack(oxide=float(self.oxide_capacitance), film=float(self.film_on_gate)),
                electron_mobility=float(self.electron_mobility),
                hole_mobility=float(self.hole_mobility),
                pair_threshold_shift=float(self.threshold - self.threshold_voltage),
            ),
        )

    def _require_single(self) -> None:
        if self.shape:
            raise ValueError(f"the design must be a single one, got arrays of shape {self.shape}; use design.at(...)")

    def follower(self) -> CircuitFollower:
        """Return the follower of a single design: the circuit, integrated over time for any input.

        Returns
        -------
        CircuitFollower
            The follower, with its ranges of validity.

        Raises
        ------
        ValueError
            The design has arrays (use `at`).
        """
        self._require_single()
        return CircuitFollower(circuit=self.op_amp)

    def linear_follower(self) -> RingingFollower:
        """Return the follower of a single design for small signals, with gain, crossing and margin of the circuit.

        Two poles and a zero, exact in time for any step and far faster than `follower`; a steeper output than the slew
        rates, and inputs out of range, are not valid.

        Returns
        -------
        RingingFollower
            The follower, with the circuit's systematic offset.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), or no operating point, or is out of its range at 0 V.
        """
        self._require_single()
        amplifier = self.amplifier
        if not np.isfinite(amplifier.lowest_input):
            raise ValueError(f"the design has no linear follower: {'; '.join(amplifier.validity.reasons)}")
        loop = circuit_figures(self.op_amp).open_loop
        return RingingFollower(
            open_loop=loop,
            offset=float(amplifier.offset / loop.closed_loop_gain),
            limits=FollowerLimits(
                v_low=float(amplifier.lowest_input),
                v_high=float(amplifier.highest_input),
                slew_rate=float(amplifier.slew_rate),
                falling_slew_rate=float(amplifier.falling_slew_rate),
            ),
        )

    def with_measured(self, gain: float, gain_bandwidth: float, phase_margin: float) -> PosfetDesign:
        """Return a single design whose op-amp has measured figures, sizes and bias being known.

        With two stages `load_resistance` is adjusted to the gain, with one stage `channel_length_modulation`;
        `compensation` and `load_capacitance` to unity crossing and phase margin (`calibrate_circuit`).

        Parameters
        ----------
        gain : float
            Measured open-loop gain [V/V], in [1.01, 1e9].
        gain_bandwidth : float
            Measured unity crossing [Hz], in [1, 1e12].
        phase_margin : float
            Measured phase margin [degrees], in [-85, 179].

        Returns
        -------
        PosfetDesign
            The adjusted design.

        Raises
        ------
        ValueError
            The design has arrays (use `at`), an argument is not real, not finite or out of range, or no plausible load
            and compensation give these figures.

        Examples
        --------
        >>> design = PosfetDesign().with_measured(400.0, 5e6, 60.0)
        >>> print(f"{design.amplifier.phase_margin:.2f} degrees with {design.load_capacitance * 1e12:.1f} pF")
        60.00 degrees with 24.7 pF
        """
        self._require_single()
        found = calibrate_circuit(self.op_amp, gain, gain_bandwidth, phase_margin)
        return dataclasses.replace(
            self,
            load_resistance=float(found.load_resistance),
            channel_length_modulation=float(found.modulation),
            compensation=float(found.compensation),
            load_capacitance=float(found.load_capacitance),
        )

    def netlist(self, name: str = "design") -> str:
        """Return the op-amp of a single design as a SPICE subcircuit, ``.subckt opamp plus minus out``.

        Parameters
        ----------
        name : str, default "design"
            Name of the circuit, of letters, digits and underscores.

        Returns
        -------
        str
            The netlist.

        Raises
        ------
        ValueError
            As for `circuit`.
        """
        return netlist.subcircuit(self.circuit(name))


def _first(design: PosfetDesign, name: str) -> str:
    return f"{float(np.asarray(getattr(design, name)).flat[0]):g}"


def _each(*values: Values | int) -> Array:
    """Return one value for each transistor along a last axis."""
    return np.stack(np.broadcast_arrays(*(np.asarray(value, np.float64) for value in values)), axis=-1)
