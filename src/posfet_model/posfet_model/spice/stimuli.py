# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Inputs that circuits are compared on: press, tap, sines of 1 kHz to 1 MHz, steps of 10 mV to 1 V up and down."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.spice.circuits import Circuit
from posfet_model.spice.ngspice import piecewise_linear
from posfet_model.spice.reference_runs import PRESS_VOLTAGE

STEPS: Final = (0.01, 0.05, 0.2, 1.0)
"""Steps [V], from 0 up and from that voltage back to 0."""

SINES: Final = ((1e3, 1.0), (1e4, 1.0), (1e5, 0.1), (1e6, 0.05))
"""Frequency [Hz] and amplitude [V]; 1 MHz is beyond the bandwidth of some circuits."""

EDGE: Final = 0.015
"""Length of a step's edge, in periods of the unity crossing: 10 ns at 1.5 MHz."""

_PULSE_POINTS: Final = 200
_SINE_POINTS: Final = 250  # per period
_BEFORE: Final = 1.5  # rest before a step, and the window after it, in periods of the unity crossing
_AFTER: Final = 8.0
_STEP_POINTS: Final = 2500


@dataclass(frozen=True, eq=False)
class Stimulus:
    """An input, piecewise linear or a sine, and the parameters of its run."""

    kind: str
    """"press", "tap", "sine", "up" or "down"."""
    source: str
    """Source in ngspice's syntax."""
    time: NDArray[np.float64]
    """Instants between which a piecewise linear input is straight, or that resolve the sine [s], from 0 to the end."""
    volts: NDArray[np.float64]
    """Input at these instants [V]."""
    largest_step: float
    """Upper limit of ngspice's time step [s]."""
    amplitude: float
    """Step or amplitude [V]."""

    @property
    def stop(self) -> float:
        """End of the run [s]."""
        return float(self.time[-1])

    def resolved(self, samples: int = 200) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return instants [s] and input [V] that resolve the input: its own, and as many evenly spaced; unchecked."""
        time = np.union1d(self.time, np.linspace(0, self.stop, samples))
        return time, np.interp(time, self.time, self.volts) if self.kind != "sine" else self._sine(time)

    def _sine(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.amplitude * np.sin(4 * math.pi * time / self.stop))  # two periods


def pulse(kind: str, width: float, lead: float, stop: float, largest_step: float) -> Stimulus:
    """Return a raised-cosine pulse of 5 N with rest before and after it; unchecked.

    Parameters
    ----------
    kind : str
        Its name.
    width : float
        Width at half height [s].
    lead, stop : float
        Start of the pulse and end of the run [s].
    largest_step : float
        Upper limit of ngspice's time step [s].

    Returns
    -------
    Stimulus
        The input.
    """
    phase = np.linspace(0, 1, _PULSE_POINTS + 1)
    volts = 0.5 * PRESS_VOLTAGE * (1 - np.cos(2 * np.pi * phase))
    time = np.r_[0.0, lead + 2 * width * phase, stop]
    return _straight(kind, time, np.r_[0.0, volts[:-1], 0.0, 0.0], largest_step, PRESS_VOLTAGE)


def sine(frequency: float, amplitude: float) -> Stimulus:
    """Return two periods of a sine of a frequency [Hz] and an amplitude [V]; unchecked."""
    time = np.linspace(0, 2 / frequency, 2 * _SINE_POINTS + 1)
    source = f"sin(0 {amplitude:.12g} {frequency:.12g})"
    volts = np.asarray(amplitude * np.sin(2 * math.pi * frequency * time))
    return Stimulus("sine", source, time, volts, float(time[1]), amplitude)


def step(low: float, high: float, unity_crossing: float, slewing: float) -> Stimulus:
    """Return a step with rest before it; unchecked.

    Parameters
    ----------
    low, high : float
        Input before and after it [V].
    unity_crossing : float
        Unity crossing of the circuit [Hz], to which edge and window are scaled.
    slewing : float
        Time that the window is longer for slewing [s].

    Returns
    -------
    Stimulus
        The input.
    """
    before, edge, after = (part / unity_crossing for part in (_BEFORE, EDGE, _AFTER))
    time = np.array([0.0, before, before + edge, before + edge + after + slewing])
    kind = "up" if high > low else "down"
    return _straight(kind, time, np.array([low, low, high, high]), time[-1] / _STEP_POINTS, abs(high - low))


def _straight(
    kind: str, time: NDArray[np.float64], volts: NDArray[np.float64], largest_step: float, amplitude: float
) -> Stimulus:
    digits = np.array([float(f"{value:.12g}") for value in time])  # as the source has them
    return Stimulus(kind, piecewise_linear(digits, volts), digits, volts, float(largest_step), amplitude)


def slewing_time(circuit: Circuit, volts: float) -> float:
    """Return the time [s] for which the currents of M5 and M8 charge the circuit's capacitors by a voltage; unchecked.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    volts : float
        The voltage [V].
    """
    bias, design = circuit.bias, circuit.design
    tail, sink = (bias.reference_current * design.aspect(name) / design.aspect("M6") for name in ("M5", "M8"))
    return volts * max(bias.compensation / tail, (bias.compensation + bias.load_capacitance) / sink)


def stimuli(circuit: Circuit, unity_crossing: float) -> dict[str, Stimulus]:
    """Return the inputs of a circuit by name.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    unity_crossing : float
        Its unity crossing, about [Hz]; steps are scaled to it.

    Returns
    -------
    dict of str to Stimulus
        The inputs.
    """
    found = {
        "press": pulse("press", 0.05, 5e-3, 0.11, 2e-4),
        "tap": pulse("tap", 1e-4, 1e-5, 2.2e-4, 4e-7),
        **{f"sine_{frequency:.0f}_hz": sine(frequency, amplitude) for frequency, amplitude in SINES},
    }
    for volts in STEPS:
        slewing = 3 * slewing_time(circuit, volts)
        found[f"up_{1e3 * volts:.0f}_mv"] = step(0.0, volts, unity_crossing, slewing)
        found[f"down_{1e3 * volts:.0f}_mv"] = step(volts, 0.0, unity_crossing, slewing)
    return found
