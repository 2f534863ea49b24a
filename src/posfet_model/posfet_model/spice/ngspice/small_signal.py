# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Runs at small signals: AC analyses of the follower and its loop, and the operating point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import real_number, whole_number
from posfet_model.amplifier.closed_loop import ClosedLoop
from posfet_model.spice.ngspice.deck import FOLLOWER, deck_text
from posfet_model.spice.ngspice.program import SpiceError, simulate


@dataclass(frozen=True)
class SmallSignal:
    """A small-signal AC analysis, both fields of shape [f]."""

    frequency: NDArray[np.float64]
    """[Hz], logarithmically spaced."""
    transfer: NDArray[np.complex128]
    """Transfer function v_out/v_in [V/V]."""


def run_follower_ac(circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50) -> SmallSignal:
    """Return the follower's small-signal transfer function.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        Ends of the frequency range [Hz], from 1e-3 to 1e13, at least a decade apart.
    per_decade : int, default 50
        Frequencies per decade, in [1, 10000].

    Returns
    -------
    SmallSignal
        Transfer function v_out/v_in.

    Raises
    ------
    ValueError
        A frequency or `per_decade` is out of range.
    SpiceError
        ngspice failed or the run is incomplete.
    """
    return _run_ac(circuit, FOLLOWER, lowest, highest, per_decade)


def run_open_loop_ac(circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50) -> SmallSignal:
    """Return the op-amp's open-loop transfer function at the follower's operating point.

    The loop is closed at 0 Hz only, through 1 GH, with 1 F to ground at the inverting input.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        As in `run_follower_ac`.
    per_decade : int, default 50
        As in `run_follower_ac`.

    Returns
    -------
    SmallSignal
        Transfer function v_out/v_in.

    Raises
    ------
    ValueError
        A number is out of range.
    SpiceError
        As of `run_follower_ac`.
    """
    loop = "lloop out feedback 1g\ncloop feedback 0 1\nxdut in feedback out opamp"
    return _run_ac(circuit, loop, lowest, highest, per_decade)


def run_loop_gain(
    circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50, v_in: float = 0.0
) -> SmallSignal:
    """Return the loop gain of the follower, with a voltage source in the closed loop at the inverting input.

    The output keeps its load by the inverting input, and the operating point is the follower's, in contrast to
    `run_open_loop_ac`. Exact but for the ratio of the impedances of output and inverting input, in contrast to
    `run_double_injection`.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        As in `run_follower_ac`.
    per_decade : int, default 50
        As in `run_follower_ac`.
    v_in : float, default 0.0
        Input at rest [V], within +-1e3.

    Returns
    -------
    SmallSignal
        Loop gain, positive at low frequency.

    Raises
    ------
    ValueError
        A number is out of range.
    SpiceError
        As of `run_follower_ac`.
    """
    loop = "vloop out feedback dc 0 ac -1\nxdut in feedback out opamp"
    volts = f"{real_number('v_in', v_in, -1e3, 1e3):.12g}"
    frequency, (feedback, out) = _ac(circuit, loop, volts, ("v(feedback)", "v(out)"), lowest, highest, per_decade)
    return SmallSignal(frequency=frequency, transfer=-out / feedback)


def run_double_injection(
    circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50, v_in: float = 0.0
) -> SmallSignal:
    """Return the loop gain of the follower, with a voltage and a current in the closed loop at the inverting input.

    ``1/(1 + T) = 1/(1 + Tv) + 1/(1 + Ti)``, exact for any impedances of output and inverting input: R. D. Middlebrook,
    Int. J. Electronics 38 (1975) 485, doi:10.1080/00207217508920421.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        As in `run_follower_ac`.
    per_decade : int, default 50
        As in `run_follower_ac`.
    v_in : float, default 0.0
        Input at rest [V], within +-1e3.

    Returns
    -------
    SmallSignal
        Loop gain, positive at low frequency.

    Raises
    ------
    ValueError
        A number is out of range.
    SpiceError
        As of `run_follower_ac`.
    """
    loops = (
        "vloop out feedback dc 0 ac -1\nxdut in feedback out opamp\n"
        "vgate middle gate dc 0\nvend end middle dc 0\niloop 0 middle dc 0 ac 1\nxsecond in gate end opamp"
    )
    volts = f"{real_number('v_in', v_in, -1e3, 1e3):.12g}"
    saved = ("v(feedback)", "i(vgate)")
    frequency, remaining = _ac(circuit, loops, volts, saved, lowest, highest, per_decade)
    return SmallSignal(frequency=frequency, transfer=1 / remaining.sum(axis=0) - 1)


def run_operating_point(circuit: str, quantities: Sequence[str]) -> NDArray[np.float64]:
    """Return quantities of the operating point of the follower, with its input at 0 V.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    quantities : sequence of str
        What ngspice is to save, such as "v(out)" or "@m.xdut.m1[gm]".

    Returns
    -------
    ndarray
        Their values in SI units, shape [quantities].

    Raises
    ------
    SpiceError
        ngspice failed or does not know a quantity.
    """
    values = simulate(deck_text(circuit, "vin in 0 dc 0", FOLLOWER, ".op", quantities), complex_values=False)
    if values.shape != (len(quantities), 1):
        raise SpiceError(f"ngspice saved {values.shape[0]} of {len(quantities)} quantities of the operating point")
    return values[:, 0].real


def closed_loop(response: SmallSignal) -> ClosedLoop:
    """Return gain at the lowest frequency and -3 dB frequency of a follower.

    Between the frequencies of the run, the gain is interpolated linearly in doubly logarithmic scale.

    Parameters
    ----------
    response : SmallSignal
        Transfer function of the follower.

    Returns
    -------
    ClosedLoop
        Gain [V/V] and bandwidth [Hz].

    Raises
    ------
    SpiceError
        The gain does not fall by 3 dB within the run.
    """
    gain = np.abs(response.transfer)
    fallen = np.flatnonzero(gain < gain[0] / math.sqrt(2))
    if not fallen.size or fallen[0] == 0:
        raise SpiceError(f"the gain does not fall by 3 dB below {response.frequency[-1]:g} Hz")
    ends = slice(fallen[0] - 1, fallen[0] + 1)
    logarithm = np.interp(-math.log(gain[0] / math.sqrt(2)), -np.log(gain[ends]), np.log(response.frequency[ends]))
    return ClosedLoop(gain=float(gain[0]), bandwidth=math.exp(float(logarithm)))


def _run_ac(circuit: str, instance: str, lowest: float, highest: float, per_decade: int) -> SmallSignal:
    frequency, (v_in, v_out) = _ac(circuit, instance, "0 ac 1", ("v(in)", "v(out)"), lowest, highest, per_decade)
    return SmallSignal(frequency=frequency, transfer=v_out / v_in)


def _ac(
    circuit: str, instance: str, source: str, saved: tuple[str, str], lowest: float, highest: float, per_decade: int
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Return the frequencies, and two voltages or currents."""
    lowest = real_number("lowest", lowest, 1e-3, 1e12)
    highest = real_number("highest", highest, 10 * lowest, 1e13)
    per_decade = whole_number("per_decade", per_decade, 1, 10_000)
    analysis = f".ac dec {per_decade} {lowest:.12g} {highest:.12g}"
    values = simulate(deck_text(circuit, f"vin in 0 dc {source}", instance, analysis, saved), complex_values=True)
    frequency = values[0].real
    if abs(frequency[-1] / highest - 1) > 0.1:
        raise SpiceError(f"ngspice stopped at {frequency[-1]:g} Hz of {highest:g} Hz")
    return frequency, values[1:]
