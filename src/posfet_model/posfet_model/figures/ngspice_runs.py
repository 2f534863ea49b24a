# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Runs of ngspice that the figures of the follower are compared with: recorded once, stored beside the figures.

``python -m posfet_model.figures.ngspice_runs [--out docs/figures]`` records them again, with the two-stage circuit of
Table II (circuit B of docs/device.md). The gate voltages come from the device model: force, charge with leakage, gate.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array
from posfet_model.device import paper
from posfet_model.device.charge import propagate_first_order_hold, source_charge
from posfet_model.device.transistor import Plane, threshold_shift
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.netlist import subcircuit

FOLDER: Final = Path("docs/figures")
"""Folder of the recorded runs, from the root of the repository."""

CIRCUIT: Final = "two_stage"
"""Name of the circuit in `posfet_model.spice.circuits`."""

PRESS_FORCE: Final = 1.5
"""Force of the press [N], raised cosine, 50 ms wide at half height."""

SINE_FORCE: Final = 1.0
"""Amplitude of the sine of 1 kHz [N]."""

FAST_AMPLITUDES: Final = {"fast_small": 0.3, "fast_large": 1.0}
"""Amplitudes of sines of 1 MHz [V], at the gate: no finger is that fast."""

STEPPED: Final = {"step_10pf": "two_stage", "step_100pf": "two_stage_100pf", "step_300pf": "two_stage_300pf"}
"""Circuit of each step of 50 mV at the gate."""

LOADS: Final = {name: CIRCUITS[circuit].bias.load_capacitance for name, circuit in STEPPED.items()}
"""Load of each of these circuits [F]."""

_POINTS: Final = 2000
"""Points of a source; between them it is linear."""

_ROWS: Final = 500
"""Rows of a file, at most; ngspice steps at least as finely as the points of its source."""


def press(time: Array) -> Array:
    """Return the force [N] of the press at the times [s]."""
    inside = (time > 0.02) & (time < 0.12)
    return np.where(inside, PRESS_FORCE * 0.5 * (1 - np.cos(2 * np.pi * (time - 0.02) / 0.1)), 0.0)


def sine(time: Array) -> Array:
    """Return the force [N] of the sine at the times [s]; a preload, whose charge has leaked, keeps it a compression."""
    return SINE_FORCE * np.sin(2e3 * np.pi * time)


FORCES: Final[dict[str, tuple[Callable[[Array], Array], float]]] = {"press": (press, 0.4), "sine": (sine, 2e-3)}
"""Force over time, and the end of the run [s], by name."""


def gate_voltage(force: Array, time: Array) -> Array:
    """Return the voltage [V] at the gate of the stack due to a force on a taxel: charge, its leakage, capacitance.

    Parameters
    ----------
    force : ndarray, shape [t]
        Compressive force [N], at rest before the first time.
    time : ndarray, shape [t]
        Increasing times [s].

    Returns
    -------
    ndarray, shape [t]
        Gate voltage [V], positive for a compression.
    """
    d33 = paper.PIEZOELECTRIC_COEFFICIENT.value
    source = source_charge(-force / paper.FORCE_AREA.value, 0.0, d33, 0.0)
    charge = np.zeros_like(time)
    for i in np.flatnonzero(np.diff(time) > 0) + 1:
        step = time[i] - time[i - 1]
        charge[i] = propagate_first_order_hold(
            charge[i - 1], source[i - 1], source[i], step, paper.LEAK_TIME_CONSTANT.value
        )
    return np.asarray(-threshold_shift(charge, paper.STACK, Plane.GATE, 1.0), np.float64)


def read(name: str, folder: Path = FOLDER) -> NDArray[np.float64]:
    """Return the columns of a recorded run.

    Parameters
    ----------
    name : str
        press, sine, fast_small, fast_large, step_* (columns time [s], v_in [V], v_out [V]); ac, open_loop (frequency
        [Hz], real and imaginary part [V/V]).
    folder : Path, default docs/figures
        Folder of the files.

    Returns
    -------
    ndarray, shape [3, t]
        Columns.

    Raises
    ------
    SystemExit
        The file is missing: the figures are drawn from the root of the repository.
    """
    path = folder / f"ngspice_{name}.csv"
    if not path.is_file():
        sys.exit(f"posfet_model.figures: {path} is missing; run from the root of the repository")
    return np.asarray(np.loadtxt(path, delimiter=",", skiprows=2).T, np.float64)


def record(folder: Path) -> list[Path]:
    """Run ngspice and write all runs.

    Parameters
    ----------
    folder : Path
        Folder of the files.

    Returns
    -------
    list of Path
        Files written.

    Raises
    ------
    ngspice.SpiceError
        ngspice is missing or a run failed.
    """
    sources = {name: (CIRCUIT, f"sin(0 {volts:g} 1meg)", 2e-6) for name, volts in FAST_AMPLITUDES.items()}
    step = ngspice.piecewise_linear([0, 2e-7, 2.1e-7, 3e-6], [0, 0, 0.05, 0.05])
    sources |= {name: (circuit, step, 3e-6) for name, circuit in STEPPED.items()}
    for name, (force, stop) in FORCES.items():
        time = np.linspace(0, stop, _POINTS + 1)
        sources[name] = (CIRCUIT, ngspice.piecewise_linear(time, gate_voltage(force(time), time)), stop)
    paths = []
    for name, (circuit, source, stop) in sources.items():
        run = ngspice.run_follower(subcircuit(CIRCUITS[circuit]), source, stop, stop / 600)
        kept = slice(None, None, -(-run.time.size // _ROWS))
        columns = (run.time[kept], run.v_in[kept], run.v_out[kept])
        paths.append(_write(folder / f"ngspice_{name}.csv", circuit, "time,v_in,v_out", columns))
    for name, run_ac, lowest in (("ac", ngspice.run_follower_ac, 1e-2), ("open_loop", ngspice.run_open_loop_ac, 1.0)):
        small = run_ac(subcircuit(CIRCUITS[CIRCUIT]), lowest, per_decade=10)
        columns = (small.frequency, small.transfer.real, small.transfer.imag)
        paths.append(_write(folder / f"ngspice_{name}.csv", CIRCUIT, "frequency,real,imaginary", columns))
    return paths


def _write(path: Path, circuit: str, header: str, columns: tuple[NDArray[np.float64], ...]) -> Path:
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"# circuit {circuit}; ngspice, gear, reltol {ngspice.RELATIVE_TOLERANCE:g}\n{header}\n")
        np.savetxt(file, np.column_stack(columns), delimiter=",", fmt="%.9g")
    return path


def main(arguments: Sequence[str] | None = None) -> int:
    """Record all runs and print the files written; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m posfet_model.figures.ngspice_runs", description=__doc__)
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder (default: %(default)s)")
    folder = parser.parse_args(arguments).out
    try:
        for path in record(folder):
            print(path)
    except (ngspice.SpiceError, OSError) as error:
        print(f"ngspice_runs: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
