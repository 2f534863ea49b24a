# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recorded runs of the set of circuits in ngspice: `python -m posfet_model.spice.recorded_runs FOLDER` makes them.

One file per circuit, NAME.npz: the loop gain in numbers, the operating point, and each run thinned out so that straight
lines between the samples deviate from it by at most `THINNING` of full scale. Each run states how much it changes with
half the tolerance and half the largest time step, the uncertainty of the reference. Where the circuit is unstable at an
end of the input's range there is no run: what ngspice shows there depends on its time step.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.amplifier.step_test import SLEWING_STEP, steepest_slope
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import CIRCUITS, Circuit
from posfet_model.spice.measurement import LoopMeasurement, measure_bias_point, measure_loop
from posfet_model.spice.netlist import subcircuit
from posfet_model.spice.record_file import Record, RecordedRun, save
from posfet_model.spice.reference_runs import version
from posfet_model.spice.stimuli import Stimulus, slewing_time, step, stimuli

THINNING: Final = 1e-4
"""Largest deviation of a thinned run [full scale]."""

BEYOND_UNITY: Final = 10.0
"""End of the AC analysis, in unity crossings."""

_HIGHEST_FREQUENCY: Final = 1e10
_PER_DECADE: Final = 10


def time_scale(loop: LoopMeasurement) -> float:
    """Return the frequency [Hz] that scales the stimuli: the unity crossing to two digits; unchecked."""
    return float(f"{loop.unity_crossing:.1e}")


def deck_hash(circuit: Circuit, inputs: Mapping[str, Stimulus]) -> str:
    """Return a hash of all that determines the runs, 16 hexadecimal digits; unchecked.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    inputs : mapping of str to Stimulus
        The inputs.
    """
    parts = [subcircuit(circuit), f"{ngspice.RELATIVE_TOLERANCE:g}"]
    parts += [f"{name} {part.source} {part.largest_step:.12g}" for name, part in inputs.items()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def record(circuit: Circuit, names: Sequence[str] | None = None) -> Record:
    """Return ngspice's runs of a circuit.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    names : sequence of str, optional
        Stimuli to run; all by default.

    Returns
    -------
    Record
        The runs.

    Raises
    ------
    ngspice.SpiceError
        ngspice is missing or a run failed.
    """
    text = subcircuit(circuit)
    loop = measure_loop(ngspice.run_loop_gain(text, highest=_HIGHEST_FREQUENCY, per_decade=100))
    inputs = stimuli(circuit, time_scale(loop))
    kept = list(inputs) if names is None else list(names)
    unstable = _unstable(text, {name: inputs[name] for name in kept})
    response = ngspice.run_loop_gain(text, highest=BEYOND_UNITY * loop.unity_crossing, per_decade=_PER_DECADE)
    follower = ngspice.closed_loop(ngspice.run_follower_ac(text, highest=_HIGHEST_FREQUENCY, per_decade=100))
    return Record(
        circuit=circuit.name,
        simulator=version(),
        deck_hash=deck_hash(circuit, inputs),
        loop=loop,
        exact_loop=measure_loop(ngspice.run_double_injection(text, highest=_HIGHEST_FREQUENCY, per_decade=100)),
        open_loop=_open_loop(text),
        bias_point=measure_bias_point(circuit),
        frequency=response.frequency,
        loop_gain=response.transfer,
        follower_gain=follower.gain,
        bandwidth=follower.bandwidth if loop.stable else math.nan,
        slew_rates=_slew_rates(circuit, loop) if loop.stable else (math.nan, math.nan),
        runs={name: _run(text, inputs[name]) for name in kept if name not in unstable},
        unstable=unstable,
    )


def _open_loop(text: str) -> LoopMeasurement:
    return measure_loop(ngspice.run_open_loop_ac(text, highest=_HIGHEST_FREQUENCY, per_decade=100))


def _unstable(text: str, inputs: Mapping[str, Stimulus]) -> tuple[str, ...]:
    """Return the stimuli in whose range the circuit is unstable: at rest at its lowest or its highest input."""
    ends = {name: (float(part.volts.min()), float(part.volts.max())) for name, part in inputs.items()}
    stable = {
        volts: measure_loop(ngspice.run_loop_gain(text, highest=_HIGHEST_FREQUENCY, v_in=volts)).stable
        for volts in {volt for pair in ends.values() for volt in pair}
    }
    return tuple(name for name, (low, high) in ends.items() if not (stable[low] and stable[high]))


def _slew_rates(circuit: Circuit, loop: LoopMeasurement) -> tuple[float, float]:
    low, high = SLEWING_STEP
    slewing = 3 * slewing_time(circuit, high - low)
    slopes = []
    for ends in ((low, high), (high, low)):
        what = step(*ends, loop.unity_crossing, slewing)
        run = ngspice.run_follower(subcircuit(circuit), what.source, what.stop, what.largest_step)
        slopes.append(steepest_slope(run.time, run.v_out, float(run.v_out[-1])))
    return slopes[0], slopes[1]


def _run(text: str, stimulus: Stimulus) -> RecordedRun:
    coarse, fine = (
        ngspice.run_follower(
            text, stimulus.source, stimulus.stop, stimulus.largest_step * share, ngspice.RELATIVE_TOLERANCE * share
        )
        for share in (1.0, 0.5)
    )
    swing = float(np.ptp(fine.v_out))
    even = np.linspace(0, stimulus.stop, 4001)
    change = np.interp(even, coarse.time, coarse.v_out) - np.interp(even, fine.time, fine.v_out)
    kept = thinned(fine.time, fine.v_out, THINNING * swing)
    return RecordedRun(fine.time[kept], fine.v_out[kept], 100 * float(np.sqrt(np.mean(change**2))) / swing)


def thinned(time: NDArray[np.float64], values: NDArray[np.float64], tolerance: float) -> NDArray[np.int64]:
    """Return which samples to keep so that straight lines between them deviate by at most a tolerance; unchecked.

    Parameters
    ----------
    time, values : ndarray
        Samples, shape [t].
    tolerance : float
        Largest deviation, in the unit of the values.

    Returns
    -------
    ndarray
        Indices, increasing, the first and the last included.
    """
    kept, pending = {0, time.size - 1}, [(0, time.size - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        line = np.interp(time[inner], time[[first, last]], values[[first, last]])
        error = np.abs(values[inner] - line)
        worst = int(error.argmax())
        if error[worst] > tolerance:
            middle = first + 1 + worst
            kept.add(middle)
            pending += [(first, middle), (middle, last)]
    return np.array(sorted(kept))


def main(arguments: Sequence[str] | None = None) -> int:
    """Record the set into a folder; return the exit code."""
    parser = argparse.ArgumentParser(prog="recorded_runs", description=__doc__)
    parser.add_argument("folder", type=Path, help="where to write, e.g. test/data/spice/circuits")
    parser.add_argument("--circuit", choices=CIRCUITS, action="append", help="record only this one")
    options = parser.parse_args(arguments)
    try:
        options.folder.mkdir(parents=True, exist_ok=True)
        for name in options.circuit or CIRCUITS:
            recorded = record(CIRCUITS[name])
            save(options.folder / f"{name}.npz", recorded)
            uncertain = max((run.uncertainty for run in recorded.runs.values()), default=math.nan)
            print(
                f"{name}: {recorded.loop.gain_db:.1f} dB, {recorded.loop.unity_crossing / 1e6:.3f} MHz, "
                f"{recorded.loop.phase_margin:.1f} degrees; {len(recorded.runs)} runs, "
                f"uncertainty at most {uncertain:.2g} %",
                flush=True,
            )
    except (ngspice.SpiceError, OSError) as error:
        print(f"recorded_runs: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
