# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Speed of the follower model against ngspice at equal step, for arrays.

Alone: `python -m benchmarks.simulation.follower_against_ngspice`.

ngspice gets one netlist with an op-amp of circuit B for each taxel, all driven by sines of different amplitude. The
cost of a step is the transient analysis time that ngspice reports over its number of time points, without netlist
parsing and operating point, times the processor share of the process, as the report is in wall-clock time. The model
takes the same steps: one after the other as in real time, and as a whole series; the minimum of 15, in processor time.
So other load on the machine matters little. Prints one line per array, with the maximum error of the last taxel
against ngspice in percent of full scale. Takes about half a minute; skipped without ngspice.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.outcome import Outcome, Table
from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH
from posfet_model.spice import ngspice

STEP = 1e-6
FREQUENCY = 10e3
ARRAYS = {64: 400, 4096: 24}
"""Number of taxels, and of the steps requested from ngspice."""
MODEL_STEPS = 500
REPEATS = 15
SAME_INPUT = 1e-4
"""Largest difference of the inputs of ngspice and the model, relative to the amplitude; the netlist has six digits."""
MISSING = f"{ngspice.PROGRAM} is not on PATH. Install with: sudo apt-get install ngspice"


def amplitudes(taxels: int) -> list[float]:
    """Return the amplitude of the sine of each taxel [V], for two taxels or more."""
    return np.linspace(0.05, 0.25, taxels).tolist()


def sine(instants: np.ndarray, volts: float | np.ndarray) -> np.ndarray:
    """Return the input [V] of a taxel at the given times [s], for an amplitude [V]."""
    return volts * np.sin(2 * np.pi * FREQUENCY * instants)


def ngspice_run(inputs: Sequence[float], steps: int) -> tuple[float, ngspice.Transient]:
    """Run ngspice with one follower for each amplitude [V].

    Returns the processor time per time point [s], and input and output of the last follower.
    """
    taxels = len(inputs)
    lines = ["array", ngspice.netlist("opamp_b")]
    for k, volts in enumerate(inputs):
        lines += [f"vin{k} in{k} 0 sin(0 {volts:.6g} {FREQUENCY:g})", f"x{k} in{k} out{k} out{k} opamp"]
    lines += [
        f".options acct method=gear reltol={ngspice.RELATIVE_TOLERANCE:g}",
        f".save v(in{taxels - 1}) v(out{taxels - 1})",
        f".tran {STEP:g} {steps * STEP:g} 0 {STEP:g}",
        ".end",
        "",
    ]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "deck.cir").write_text("\n".join(lines), encoding="ascii")
        command = [ngspice.PROGRAM, "-n", "-b", "-r", "out.raw", "deck.cir"]
        processor, clock = _children_seconds(), time.perf_counter()
        log = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout
        share = (_children_seconds() - processor) / (time.perf_counter() - clock)
        values = ngspice.read_raw((Path(folder) / "out.raw").read_bytes(), complex_values=False).real
    account = dict(line.split(" = ", 1) for line in log.splitlines() if line.count(" = ") == 1)
    seconds = float(account["Transient analysis time"]) / float(account["Accepted timepoints"])
    return seconds * share, ngspice.Transient(values[0], values[1], values[2])


def _children_seconds() -> float:
    """Return the processor time of finished child processes [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def model_seconds(taxels: int, steps: int) -> tuple[float, float]:
    """Return the processor time [s] of the model's steps, one after the other and as a whole series."""
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    follower = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth)
    instants = np.arange(steps + 1) * STEP
    v_in = sine(instants[:, None], np.array(amplitudes(taxels)))
    begin = time.process_time()
    state = follower.start(v_in[0])
    for k in range(1, steps + 1):
        state = follower.advance(state, v_in[k], STEP)
        follower.output(state)
    middle = time.process_time()
    follower.run(instants, v_in)
    return middle - begin, time.process_time() - middle


def check_same_input(reference: ngspice.Transient, volts: float) -> None:
    """Raise RuntimeError if the input of ngspice is not that of the model, so that outputs are not comparable."""
    largest = float(np.max(np.abs(reference.v_in - sine(reference.time, volts))))
    if not largest <= SAME_INPUT * volts:
        raise RuntimeError(
            f"model and reference have different inputs: {largest:.3g} V apart with a sine of {volts:g} V"
        )


def error_percent(reference: ngspice.Transient, volts: float, even: np.ndarray, v_out: np.ndarray) -> float:
    """Return the largest error of the model's response to a sine, in percent of its peak-to-peak amplitude.

    `v_out` [V] is the response at the times `even` [s] to a sine of amplitude `volts` [V]; the initial value is
    subtracted. Raises RuntimeError if the reference had another input.
    """
    check_same_input(reference, volts)
    expected = np.interp(even, reference.time, reference.v_out)
    return 100 * float(np.max(np.abs(v_out - expected + expected[0]))) / (2 * volts)


def array_error(reference: ngspice.Transient, volts: float) -> float:
    """Return the model's error at steps of STEP, as in `error_percent`."""
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    even = np.arange(0, reference.time[-1], STEP)
    answer = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth).run(even, sine(even, volts))
    return error_percent(reference, volts, even, answer.v_out)


def measure(full: bool) -> Outcome:
    """Time ngspice and the model."""
    if not ngspice.available():
        return Outcome(skipped=MISSING)
    values: dict[str, float] = {}
    rows = []
    for taxels, steps in ARRAYS.items():
        inputs = amplitudes(taxels)
        per_step, reference = ngspice_run(inputs, steps * (4 if full else 1))
        runs = np.array([model_seconds(taxels, MODEL_STEPS) for _ in range(REPEATS)]) / MODEL_STEPS
        stepped, series = runs.min(axis=0)
        error = array_error(reference, inputs[-1])
        rows.append((taxels, *(1e6 * seconds for seconds in (per_step, stepped)), per_step / stepped,
                     1e6 * series, per_step / series, error))  # fmt: skip
        values[f"sim_vs_ngspice_{taxels}"] = per_step / min(stepped, series)
        values[f"sim_vs_ngspice_{taxels}_stepped"] = per_step / stepped
        values[f"sim_vs_ngspice_{taxels}_error_pct"] = error
    columns = (
        "taxels",
        "ngspice us per step",
        "model, step by step us",
        "ratio",
        "model, series us",
        "ratio",
        "error %",
    )
    note = (
        "Steps of 1 us for both, sines of 10 kHz; ngspice simulates the op-amp of circuit B for each taxel, the "
        "model one pole. Error of the last taxel in percent of its full scale. The named ratio is that of the faster "
        "variant."
    )
    return Outcome(values, [Table("Followers against ngspice at equal step", columns, rows, note)])


def main() -> int:
    """Measure and print."""
    if not ngspice.available():
        print(f"skipped: {MISSING}")
        return 0
    for taxels, steps in ARRAYS.items():
        inputs = amplitudes(taxels)
        per_step, reference = ngspice_run(inputs, steps)
        runs = np.array([model_seconds(taxels, MODEL_STEPS) for _ in range(REPEATS)]) / MODEL_STEPS
        stepped, series = runs.min(axis=0)
        error = array_error(reference, inputs[-1])
        print(
            f"{taxels} taxels, {STEP * 1e6:g} us: ngspice {per_step * 1e6:.0f} us per step; model step by step "
            f"{stepped * 1e6:.1f} us, ratio {per_step / stepped:.0f}; as a series {series * 1e6:.1f} us, "
            f"ratio {per_step / series:.0f}; error {error:.3f} % of full scale"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
