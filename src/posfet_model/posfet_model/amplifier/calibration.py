# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""An op-amp circuit adjusted to measured figures.

Sizes and bias of a design are known; what is not are the channel-length modulation or the load resistance, which decide
the gain, the compensation capacitor, which decides the unity crossing, and the load capacitance, such as that of a
cable, which decides the phase margin. Newton's method finds them. Where more was measured, more is found in the same
way: the zero resistor from the bandwidth of the follower, which tells a zero from a second pole of the same margin; the
bias current from the slew rate of a rise, and the sink M8 from that of a fall, which are those of the integrated step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import circuit_figures
from posfet_model.amplifier.step_test import slew_rates
from posfet_model.amplifier.transient_follower import CircuitFollower

FIGURES: Final = ("gain", "gain_bandwidth", "phase_margin", "bandwidth", "slew_rate", "falling_slew_rate")
"""Arguments of `calibrate_circuit`."""

_ITERATIONS: Final = 40
_DIFFERENCE: Final = 1e-4
_MOST_CHANGE: Final = 1.0  # of a logarithm in an iteration
_TOLERANCE: Final = 1e-8
_RANGE: Final = 7.0  # of a logarithm: a factor of 1000 either way

_RESISTORS: Final = (0.0, 0.25, 0.5, 1.0, 1.5, 2.5)  # starts of the search, in 1/gm of M7
_RESISTOR_DIFFERENCE: Final = 0.02  # in 1/gm of M7
_MOST_RESISTOR: Final = 10.0  # largest change, in that difference
_RESISTOR_ITERATIONS: Final = 15
_BANDWIDTH_TOLERANCE: Final = 1e-4
_BANDWIDTH_REACHED: Final = 0.05  # at the extremum over the resistor, or without one

_SLEW_ITERATIONS: Final = 8
_SLEW_DIFFERENCE: Final = 0.02
_SLEW_DAMPING: Final = 1e-2  # of a fall that does not depend on the sink
_SLEW_TOLERANCE: Final = 1e-3
_SLEW_REACHED: Final = 0.05


class MeasuredFigureError(ValueError):
    """Measured figures that contradict the circuit or each other, with the names of the arguments left open.

    Parameters
    ----------
    template : str
        What is wrong, with each name of an argument of `calibrate_circuit` in braces.
    """

    def __init__(self, template: str) -> None:
        super().__init__(self.named(template, {}))
        self.template = template

    @staticmethod
    def named(template: str, names: Mapping[str, str]) -> str:
        """Return what is wrong in the words of a file: with other names of the arguments.

        Parameters
        ----------
        template : str
            As of the error.
        names : mapping of str to str
            Other name by argument; one that is missing stays.
        """
        return template.format_map({name: names.get(name, name) for name in FIGURES})


@dataclass(frozen=True)
class _Measured:
    """Logarithms of the figures, the margin in radians; None where not measured."""

    loop: tuple[float, float, float]
    bandwidth: float | None
    slews: tuple[float, ...]


def calibrate_circuit(
    circuit: AmplifierCircuit,
    gain: float,
    gain_bandwidth: float,
    phase_margin: float,
    *,
    bandwidth: float | None = None,
    slew_rate: float | None = None,
    falling_slew_rate: float | None = None,
) -> AmplifierCircuit:
    """Return the circuit whose figures are the measured ones.

    With two stages the load resistance is adjusted to the gain, with one stage lambda; Cc and the load capacitance to
    unity crossing and phase margin. Of the figures that may be left out, `bandwidth` adjusts Rz, `slew_rate` the
    reference current, and `falling_slew_rate` the width of M8.

    Parameters
    ----------
    circuit : AmplifierCircuit
        The design, one circuit.
    gain : float
        Measured open-loop gain [V/V], in [1.01, 1e9].
    gain_bandwidth : float
        Measured unity crossing [Hz], in [1, 1e12].
    phase_margin : float
        Measured phase margin [degrees], in [-85, 179].
    bandwidth : float, optional
        Measured -3 dB frequency of the follower [Hz], in [1, 1e12]; two stages only.
    slew_rate : float, optional
        Measured slew rate of a rise, as of `step_test.slew_rates` [V/s], in [1, 1e15].
    falling_slew_rate : float, optional
        The same of a fall [V/s]; needs `slew_rate`. A fall that the sink does not limit leaves M8 as it is.

    Returns
    -------
    AmplifierCircuit
        The adjusted circuit.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or no values within a factor of 1000 give these figures:
        then sizes or bias are others (`MeasuredFigureError`).

    Examples
    --------
    The op-amp of the paper with a cable of 100 pF, from its measured figures:

    >>> from posfet_model.amplifier.calibration import calibrate_circuit
    >>> from posfet_model.amplifier.circuit import AmplifierCircuit
    >>> found = calibrate_circuit(AmplifierCircuit.from_design(), 130.16, 1.0084e6, 53.65)
    >>> print(f"{found.load_capacitance * 1e12:.0f} pF")
    100 pF
    """
    circuit = instance("circuit", circuit, AmplifierCircuit)
    if circuit.shape:
        raise ValueError(f"circuit must be a single one, got an array of shape {circuit.shape}")
    loop = (
        math.log(real_number("gain", gain, 1.01, 1e9)),
        math.log(real_number("gain_bandwidth", gain_bandwidth, 1, 1e12)),
        math.radians(real_number("phase_margin", phase_margin, -85, 179)),
    )
    wide = None if bandwidth is None else math.log(real_number("bandwidth", bandwidth, 1, 1e12))
    slews = {"slew_rate": slew_rate, "falling_slew_rate": falling_slew_rate}
    given = [math.log(real_number(name, rate, 1, 1e15)) for name, rate in slews.items() if rate is not None]
    if wide is not None and circuit.stages == 1:
        raise MeasuredFigureError("{bandwidth} must be left out with one stage, which has no zero resistor to adjust")
    if slew_rate is None and falling_slew_rate is not None:
        raise MeasuredFigureError("{slew_rate} must be given where {falling_slew_rate} is")
    return _slewing_as(_Measured(loop, wide, tuple(given)), circuit)


def _slewing_as(measured: _Measured, circuit: AmplifierCircuit) -> AmplifierCircuit:
    """Return the circuit of the measured slew rates, and in each iteration of all other figures."""
    if not measured.slews:
        return _small_signals(measured, circuit)
    try:
        return _slewing_from(measured, circuit, 0.0)
    except ValueError:
        # Slew rate over unity crossing is the pair's overdrive, which grows with the root of the current.
        before = circuit_figures(circuit)
        overdrive = measured.slews[0] - measured.loop[1] - math.log(before.slew_rate / before.gain_bandwidth)
        if not math.isfinite(overdrive):
            raise
    try:
        return _slewing_from(measured, circuit, min(max(2 * overdrive, -_RANGE), _RANGE))
    except MeasuredFigureError:
        _small_signals(measured, circuit)  # raises where it is not the slew rates that cannot be reached
        raise _unreachable(measured, "") from None


def _unreachable(measured: _Measured, more: str) -> MeasuredFigureError:
    names = "{slew_rate} and {falling_slew_rate}" if len(measured.slews) > 1 else "{slew_rate}"
    rates = ", ".join(f"{math.exp(rate):g}" for rate in measured.slews)
    return MeasuredFigureError(
        f"{names} must be reachable by the bias current and M8 of this circuit, with the other figures as given, "
        f"got {rates} V/s{more}"
    )


def _slewing_from(measured: _Measured, circuit: AmplifierCircuit, current: float) -> AmplifierCircuit:
    """Return the same, searched from a logarithm of the reference current."""
    wanted = np.array(measured.slews)
    scales = np.r_[current, 0.0][: wanted.size]

    resistor: Array | None = None

    def missing(at: Array) -> tuple[Array, AmplifierCircuit]:
        nonlocal resistor
        found = _small_signals(measured, _with_currents(circuit, at), near=resistor)
        resistor = found.zero_resistor
        with np.errstate(divide="ignore", invalid="ignore"):
            return wanted - np.log(slew_rates(CircuitFollower(circuit=found)))[: wanted.size], found

    error, found = missing(scales)
    steps = _SLEW_DIFFERENCE * np.eye(wanted.size)
    slopes = np.stack([(error - missing(scales + step)[0]) / _SLEW_DIFFERENCE for step in steps], axis=-1)
    for _ in range(_SLEW_ITERATIONS):
        if not np.isfinite(error).all() or np.abs(error).max() <= _SLEW_TOLERANCE:
            break
        change = np.linalg.solve(slopes.T @ slopes + _SLEW_DAMPING * np.eye(wanted.size), slopes.T @ error)
        change = np.clip(change, -_MOST_CHANGE, _MOST_CHANGE)
        scales = np.clip(scales + change, -_RANGE, _RANGE)
        last = error
        error, found = missing(scales)
        slopes = slopes + np.outer(last - error - slopes @ change, change) / (change @ change)  # Broyden's update
    if not np.abs(error).max() <= _SLEW_REACHED:
        reached = ", ".join(f"{math.exp(rate):g}" for rate in wanted - error)
        raise _unreachable(measured, f"; reached are {reached} V/s")
    return found


def _with_currents(circuit: AmplifierCircuit, scales: Array) -> AmplifierCircuit:
    """Return the circuit with other currents, by logarithms: the reference current, and M8's share of it."""
    current, sink = (*np.exp(scales), 1.0)[:2]
    width = np.array([1.0] * 7 + [sink])
    return replace(
        circuit,
        reference_current=circuit.reference_current * current,
        beta=circuit.beta * width,
        gate_area=circuit.gate_area * width,
    )


def _small_signals(measured: _Measured, circuit: AmplifierCircuit, near: Array | None = None) -> AmplifierCircuit:
    """Return the circuit of the measured loop, with a resistor of the measured bandwidth, near a known one if any."""
    wanted = measured.bandwidth
    if wanted is None:
        return _newton(circuit, measured.loop)
    if near is not None:
        circuit = replace(circuit, zero_resistor=near)
    best, miss = None, math.inf
    # The bandwidth has an extremum over the resistor: the root next to the design's own resistor is preferred.
    for ratio in (None, *_RESISTORS):
        start = circuit if ratio is None else replace(circuit, zero_resistor=np.asarray(ratio * _unit(circuit)))
        found, missing = _with_bandwidth(measured.loop, wanted, start)
        if missing < miss:
            best, miss = found, missing
        if miss <= (_BANDWIDTH_TOLERANCE if near is None else _BANDWIDTH_REACHED):
            break
    if best is None or miss > _BANDWIDTH_REACHED:
        raise MeasuredFigureError(
            "{bandwidth} must be reachable by the zero resistor of this circuit, with the other figures as given, "
            f"got {math.exp(wanted):g} Hz"
        )
    return best


def _with_bandwidth(
    loop: tuple[float, float, float], wanted: float, circuit: AmplifierCircuit
) -> tuple[AmplifierCircuit | None, float]:
    """Return the circuit of a loop whose bandwidth is nearest to a wanted one near its resistor, and what it misses."""
    best, miss, step = None, math.inf, _RESISTOR_DIFFERENCE * _unit(circuit)
    resistor, last = float(circuit.zero_resistor), None
    for _ in range(_RESISTOR_ITERATIONS):
        try:
            found = _newton(replace(circuit, zero_resistor=np.asarray(resistor)), loop)
        except ValueError:
            break
        missing = wanted - math.log(float(circuit_figures(found).closed_loop_response.bandwidth))
        if abs(missing) < miss:
            best, miss = found, abs(missing)
        if not abs(missing) > 0.1 * _BANDWIDTH_TOLERANCE:
            break
        slope = 0.0 if last is None else (last[1] - missing) / (resistor - last[0])
        change = step if slope == 0 else min(max(missing / slope, -_MOST_RESISTOR * step), _MOST_RESISTOR * step)
        last, circuit, resistor = (resistor, missing), found, max(resistor + change, 0.0)
        if resistor == last[0]:
            break
    return best, miss


def _newton(circuit: AmplifierCircuit, loop: tuple[float, float, float]) -> AmplifierCircuit:
    """Return the circuit of a loop, by Newton's method on the logarithms of what is adjusted."""
    wanted, adjusted = np.array(loop), np.zeros(3)
    for _ in range(_ITERATIONS):
        values = _figures(circuit, adjusted + _DIFFERENCE * np.eye(4, 3, -1))
        missing = wanted - values[0]
        if not np.isfinite(values).all() or np.abs(missing).max() <= _TOLERANCE:
            break
        slopes = (values[1:] - values[0]).T / _DIFFERENCE
        change = np.linalg.lstsq(slopes, missing, rcond=1e-9)[0]
        change *= min(1.0, _MOST_CHANGE / np.abs(change).max())
        adjusted = np.clip(adjusted + change, -_RANGE, _RANGE)
    if not np.abs(missing).max() <= 1e-6:
        gain, crossing, margin = math.exp(loop[0]), math.exp(loop[1]), math.degrees(loop[2])
        raise MeasuredFigureError(
            "{gain}, {gain_bandwidth} and {phase_margin} must be reachable by load and compensation of this circuit, "
            f"got {gain:g} ({20 * math.log10(gain):.4g} dB), {crossing:g} Hz and {margin:g} degrees"
        )
    return _with(circuit, adjusted)


def _figures(circuit: AmplifierCircuit, adjusted: Array) -> Array:
    """Return ln(gain), ln(unity crossing) and the phase margin [rad] of circuits adjusted by logarithms [k, 3]."""
    found = circuit_figures(_with(circuit, adjusted))
    return np.stack([np.log(found.gain), np.log(found.gain_bandwidth), np.deg2rad(found.phase_margin)], axis=-1)


def _unit(circuit: AmplifierCircuit) -> float:
    """Return 1/gm of M7 [ohm], the resistor that moves the zero to infinity."""
    gm = circuit.transistors(circuit.operating_point(0.0), np.zeros(()))[2].transconductance
    return 1 / max(abs(float(gm[6])), 1e-12)


def _with(circuit: AmplifierCircuit, adjusted: Array) -> AmplifierCircuit:
    gain, speed, load = np.exp(np.moveaxis(adjusted, -1, 0))
    name = "load_resistance" if circuit.stages == 2 else "modulation"
    return replace(
        circuit,
        compensation=circuit.compensation * speed,
        load_capacitance=np.maximum(circuit.load_capacitance, 1e-15) * load,
        **{name: getattr(circuit, name) * gain},
    )
