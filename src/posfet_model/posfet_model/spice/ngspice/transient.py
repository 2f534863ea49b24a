# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Transient runs of a follower, complete and resolved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import real_number
from posfet_model.spice.ngspice.deck import FOLLOWER, RELATIVE_TOLERANCE, deck_text
from posfet_model.spice.ngspice.program import SpiceError, simulate

COARSEST_OUTPUT_STEP: Final = 0.05
"""Largest change of the output from sample to sample of a resolved run, relative to its peak-to-peak [1]."""

_LEAST_TIME_STEPS: Final = 20


@dataclass(frozen=True)
class Transient:
    """A transient analysis, all fields of shape [t]."""

    time: NDArray[np.float64]
    """[s], uneven steps."""
    v_in: NDArray[np.float64]
    """Input voltage [V]."""
    v_out: NDArray[np.float64]
    """Output voltage [V]."""


def run_follower(
    circuit: str, source: str, stop: float, largest_step: float, relative_tolerance: float = RELATIVE_TOLERANCE
) -> Transient:
    """Return the follower's response to a source, complete and resolved.

    Parameters
    ----------
    circuit : str
        Text of a netlist with a subcircuit ``opamp plus minus out`` that contains its own supplies.
    source : str
        An ngspice source such as from `piecewise_linear`, or "sin(0 1 1k)".
    stop : float
        End of the run [s], in (0, 1e6].
    largest_step : float
        Upper limit of ngspice's time step [s], at most stop/20.
    relative_tolerance : float, default RELATIVE_TOLERANCE
        ngspice's reltol [1], in [1e-9, 1e-2].

    Returns
    -------
    Transient
        Input and output over time.

    Raises
    ------
    ValueError
        `stop`, `largest_step` or `relative_tolerance` is out of range.
    SpiceError
        ngspice failed, or the run is incomplete or too coarse; the message says why.
    """
    stop = real_number("stop", stop, 1e-12, 1e6)
    largest_step = real_number("largest_step", largest_step, stop * 1e-9, stop / _LEAST_TIME_STEPS)
    tolerance = real_number("relative_tolerance", relative_tolerance, 1e-9, 1e-2)
    analysis = f".tran {largest_step:.12g} {stop:.12g} 0 {largest_step:.12g}"
    source = f"vin in 0 {source}"
    values = simulate(deck_text(circuit, source, FOLLOWER, analysis, tolerance=tolerance), complex_values=False)
    run = Transient(time=values[0].real, v_in=values[1].real, v_out=values[2].real)
    _check_transient(run, stop, largest_step)
    return run


def _check_transient(run: Transient, stop: float, largest_step: float) -> None:
    """Raise SpiceError unless the run is finite, complete and fine enough."""
    if not all(np.isfinite(part).all() for part in (run.time, run.v_in, run.v_out)):
        raise SpiceError("ngspice's run contains values that are not finite")
    if abs(run.time[-1] - stop) > 1e-6 * stop:
        raise SpiceError(f"ngspice stopped at {run.time[-1]:g} s of {stop:g} s")
    steps = np.diff(run.time)
    if steps.min() < 0 or steps.max() > largest_step * (1 + 1e-6):
        raise SpiceError(
            f"ngspice's steps range from {steps.min():g} to {steps.max():g} s, at most {largest_step:g} s is allowed"
        )
    jump, swing = np.abs(np.diff(run.v_out)).max(), np.ptp(run.v_out)
    if jump > COARSEST_OUTPUT_STEP * swing:
        raise SpiceError(
            f"the run is too coarse: the output changes by {100 * jump / swing:.1f} % of its swing in one step"
        )
