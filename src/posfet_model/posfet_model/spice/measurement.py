# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What ngspice shows of a circuit: operating point, loop gain, phase margin and overshoot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.amplifier.transistor_point import TransistorPoint
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import Circuit
from posfet_model.spice.netlist import subcircuit

_QUANTITIES: Final = ("id", "vgs", "vds", "vdsat", "gm", "gds", "cgs", "cgd", "cgb")
_NAMES: Final = tuple(f"M{number}" for number in range(1, 9))


@dataclass(frozen=True)
class BiasPoint:
    """Operating point of a follower with its input at 0 V."""

    v_out: float
    """Output voltage, the systematic offset [V]."""
    transistors: Mapping[str, TransistorPoint]
    """M1 to M8."""


@dataclass(frozen=True)
class LoopMeasurement:
    """Loop gain of a follower in numbers."""

    gain: float
    """A0, loop gain at the lowest frequency [V/V]."""
    dominant_pole: float
    """Frequency at which the loop gain has fallen by 3 dB [Hz]."""
    unity_crossing: float
    """Lowest frequency at which the loop gain is 1 [Hz]."""
    phase_margin: float
    """180 degrees plus the phase there, negative for an unstable follower [degrees]."""

    @property
    def gain_db(self) -> float:
        """A0 [dB]."""
        return 20 * math.log10(self.gain)

    @property
    def stable(self) -> bool:
        """Whether the follower is stable: the phase margin of a loop gain that crosses 1 once decides it."""
        return self.phase_margin > 0


def measure_bias_point(circuit: Circuit) -> BiasPoint:
    """Return the operating point of the follower in ngspice.

    Parameters
    ----------
    circuit : Circuit
        The circuit.

    Returns
    -------
    BiasPoint
        Output voltage and all transistors.

    Raises
    ------
    ngspice.SpiceError
        ngspice failed.
    """
    wanted = [f"@m.xdut.{name.lower()}[{quantity}]" for name in _NAMES for quantity in _QUANTITIES]
    values = ngspice.run_operating_point(subcircuit(circuit), ["v(out)", *wanted])
    table = np.abs(values[1:]).reshape(len(_NAMES), -1).tolist()
    return BiasPoint(
        v_out=float(values[0]),
        transistors={name: TransistorPoint(*row) for name, row in zip(_NAMES, table, strict=True)},
    )


def measure_loop(response: ngspice.SmallSignal) -> LoopMeasurement:
    """Return gain, pole, unity crossing and phase margin of a loop gain.

    Between the frequencies, magnitude and phase are interpolated linearly over the logarithm of the frequency.

    Parameters
    ----------
    response : ngspice.SmallSignal
        Loop gain, from `ngspice.run_loop_gain`.

    Returns
    -------
    LoopMeasurement
        The numbers.

    Raises
    ------
    ngspice.SpiceError
        The loop gain does not fall to 1 within the run.
    """
    magnitude = np.log(np.abs(response.transfer))
    phase = np.degrees(np.unwrap(np.angle(response.transfer)))
    log_frequency = np.log(response.frequency)
    crossing = _falls_to(0.0, magnitude, log_frequency)
    return LoopMeasurement(
        gain=math.exp(magnitude[0]),
        dominant_pole=math.exp(_falls_to(magnitude[0] - 0.5 * math.log(2), magnitude, log_frequency)),
        unity_crossing=math.exp(crossing),
        phase_margin=180 + float(np.interp(crossing, log_frequency, phase)),
    )


def _falls_to(level: float, magnitude: NDArray[np.float64], position: NDArray[np.float64]) -> float:
    below = np.flatnonzero(magnitude < level)
    if not below.size or below[0] == 0:
        raise ngspice.SpiceError("the loop gain does not fall to 1 within the run")
    ends = slice(below[0] - 1, below[0] + 1)
    return float(np.interp(-level, -magnitude[ends], position[ends]))


def overshoot(v_out: NDArray[np.float64], final: float) -> float:
    """Return how far the output of a step goes beyond its final value, relative to the step.

    Parameters
    ----------
    v_out : ndarray
        Output over time [V], at rest first.
    final : float
        Final value [V].

    Returns
    -------
    float
        Overshoot [1], 0 if there is none.
    """
    step = final - float(v_out[0])
    return max(0.0, float(np.max((v_out - v_out[0]) / step)) - 1)


def oscillates(v_out: NDArray[np.float64]) -> bool:
    """Return whether a step's output, evenly sampled, still swings at the end and no less than before.

    Parameters
    ----------
    v_out : ndarray
        Output [V] at even steps, from the step on.

    Returns
    -------
    bool
        Whether the swing of the last fifth is above 5 % of the whole and no less than 0.95 of that of the fifth before.
    """
    fifth = v_out.size // 5
    last, before = np.ptp(v_out[-fifth:]), np.ptp(v_out[-2 * fifth : -fifth])
    return bool(last > 0.05 * np.ptp(v_out) and last >= 0.95 * before)
