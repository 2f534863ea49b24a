"""Speed of the follower model against ngspice at equal step, for arrays: `python benchmarks/sim_vs_ngspice.py`.

ngspice gets one netlist with an op-amp of circuit B for each taxel, all fed with sines of different amplitude. The cost
of a step is ngspice's own account of its transient analysis over its time points, so that reading the netlist and
finding the operating point do not count, times the share of the processor that the process had: the account is by the
clock. The model takes the same steps: one after the other as in real time, and as a whole series; the best of 15, in
processor time. So other programs on the machine count little. Prints one line an array, with the largest error of the
last taxel against ngspice in percent of full scale, over the time that was run. Needs ngspice; about half a minute.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "src" / "posfet_model"))
sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from benchmarks.outcome import Chart, Outcome, Point, Table
from posfet_model.amplifier.closed_loop import close_loop
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH
from posfet_model.spice import ngspice

STEP = 1e-6
FREQUENCY = 10e3
ARRAYS = {64: 400, 4096: 24}
"""Taxels, and the steps that ngspice is asked for."""
MODEL_STEPS = 500
REPEATS = 15


def amplitudes(taxels: int) -> np.ndarray:
    """Amplitude of each taxel's sine [V]."""
    return np.linspace(0.05, 0.25, taxels)


def ngspice_run(taxels: int, steps: int, step: float = STEP, stop: float = 0.0) -> tuple[float, np.ndarray, np.ndarray]:
    """Run ngspice; return its processor time a time point [s], times [s] and the last taxel's output [V]."""
    lines = ["array", ngspice.netlist("opamp_b")]
    for k, volts in enumerate(amplitudes(taxels)):
        lines += [f"vin{k} in{k} 0 sin(0 {volts:.6g} {FREQUENCY:g})", f"x{k} in{k} out{k} out{k} opamp"]
    stop = stop or steps * step
    lines += [
        f".options acct method=gear reltol={ngspice.RELATIVE_TOLERANCE:g}",
        f".save v(in{taxels - 1}) v(out{taxels - 1})",
        f".tran {step:g} {stop:g} 0 {step:g}",
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
    return seconds * share, values[0], values[2]


def _children_seconds() -> float:
    """Processor time that finished child processes took [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def model_seconds(taxels: int, steps: int) -> tuple[float, float]:
    """Return the processor time [s] of the model's steps, one after the other and as a whole series."""
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    follower = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth)
    instants = np.arange(steps + 1) * STEP
    v_in = np.sin(2 * np.pi * FREQUENCY * instants)[:, None] * amplitudes(taxels)
    begin = time.process_time()
    state = follower.start(v_in[0])
    for k in range(1, steps + 1):
        state = follower.advance(state, v_in[k], STEP)
        follower.output(state)
    middle = time.process_time()
    follower.run(instants, v_in)
    return middle - begin, time.process_time() - middle


def error_percent(instants: np.ndarray, v_out: np.ndarray, volts: float) -> float:
    """Return the model's largest error at its own even steps, in percent of the sine's peak-to-peak, start removed."""
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    even = np.arange(0, instants[-1], STEP)
    answer = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth).run(
        even, volts * np.sin(2 * np.pi * FREQUENCY * even)
    )
    reference = np.interp(even, instants, v_out)
    return 100 * float(np.max(np.abs(answer.v_out - reference + reference[0]))) / (2 * volts)


def measure(full: bool) -> Outcome:
    """Time ngspice and the model beside it, with steps that grow; one point of the front is one step width."""
    if not ngspice.available():
        raise RuntimeError(f"{ngspice.PROGRAM} is not on PATH")
    values: dict[str, float] = {}
    rows = []
    for taxels, steps in ARRAYS.items():
        per_step, instants, v_out = ngspice_run(taxels, steps * (4 if full else 1))
        runs = np.array([model_seconds(taxels, MODEL_STEPS) for _ in range(REPEATS)]) / MODEL_STEPS
        stepped, series = runs.min(axis=0)
        error = error_percent(instants, v_out, float(amplitudes(taxels)[-1]))
        rows.append((taxels, *(1e6 * seconds for seconds in (per_step, stepped)), per_step / stepped,
                     1e6 * series, per_step / series, error))  # fmt: skip
        values[f"sim_vs_ngspice_{taxels}"] = per_step / min(stepped, series)
        values[f"sim_vs_ngspice_{taxels}_stepped"] = per_step / stepped
        values[f"sim_vs_ngspice_{taxels}_error_pct"] = error
    columns = ("taxels", "ngspice us a step", "model, step by step us", "times", "model, series us", "times", "error %")
    note = (
        "Steps of 1 us for both, sines of 10 kHz; ngspice has circuit B's op-amp a taxel, the model one pole. Errors "
        "of the last taxel in percent of its full scale. The ratio by name is that of the faster of the two ways."
    )
    return Outcome(values, [Table("Followers against ngspice at equal step", columns, rows, note)], [front()])


def front() -> Chart:
    """Return run time against error of the model and of ngspice, one taxel, for steps from 0.25 to 8 us."""
    finest = ngspice_series(0.02e-6)
    stop = finest[0][-1]
    series: dict[str, list[Point]] = {"ngspice": [], "one pole, exact for a straight line": []}
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    follower = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth)
    volts = 0.25
    for step in (0.25e-6, 0.5e-6, 1e-6, 2e-6, 4e-6, 8e-6):
        instants, v_out, seconds = ngspice_series(step)
        error = float(np.max(np.abs(v_out - np.interp(instants, finest[0], finest[1]))))
        series["ngspice"].append((seconds, max(50 * error / volts, 1e-6), f"{step * 1e6:g} us"))
        even = np.arange(0, stop, step)
        v_in = volts * np.sin(2 * np.pi * FREQUENCY * even)
        taken = []
        for _ in range(REPEATS):
            begin = time.process_time()
            answer = follower.run(even, v_in)
            taken.append(time.process_time() - begin)
        reference = np.interp(even, finest[0], finest[1])
        error = float(np.max(np.abs(answer.v_out - reference + reference[0])))
        series["one pole, exact for a straight line"].append((min(taken), 50 * error / volts, f"{step * 1e6:g} us"))
    return Chart(
        "front_follower",
        f"One follower, {stop * 1e6:.0f} us of a sine of 10 kHz; reference: ngspice at 0.02 us",
        "run time [s]",
        "largest error [% of full scale]",
        series,
    )


def ngspice_series(step: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times [s] and output [V] of a single follower, and what ngspice's transient analysis took [s]."""
    seconds, instants, v_out = ngspice_run(1, 200, step, 200e-6)
    return instants, v_out, seconds * len(instants)


def main() -> int:
    """Measure and print."""
    if not ngspice.available():
        print(f"{ngspice.PROGRAM} is not on PATH", file=sys.stderr)
        return 1
    for taxels, steps in ARRAYS.items():
        per_step, instants, v_out = ngspice_run(taxels, steps)
        runs = np.array([model_seconds(taxels, MODEL_STEPS) for _ in range(REPEATS)]) / MODEL_STEPS
        stepped, series = runs.min(axis=0)
        volts = float(amplitudes(taxels)[-1])
        error = error_percent(instants, v_out, volts)
        print(
            f"{taxels} taxels, {STEP * 1e6:g} us: ngspice {per_step * 1e6:.0f} us a step; model step by step "
            f"{stepped * 1e6:.1f} us, ratio {per_step / stepped:.0f}; as a series {series * 1e6:.1f} us, "
            f"ratio {per_step / series:.0f}; error {error:.3f} % of full scale"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
