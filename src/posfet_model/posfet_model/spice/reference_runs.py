# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Generate the stored ngspice runs of the tests: `python -m posfet_model.spice.reference_runs FOLDER`."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.device.paper import FORCE_AREA, PIEZOELECTRIC_COEFFICIENT, STACK
from posfet_model.spice import ngspice

PRESS_FORCE: Final = 5.0
"""Force of press and tap [N]."""

PRESS_VOLTAGE: Final = -PIEZOELECTRIC_COEFFICIENT.value * PRESS_FORCE / FORCE_AREA.value / STACK.oxide
"""Gate shift by 5 N on 1 mm2 at the oxide plane, d33*F/(A*Cox) = 0.248 V. Referred to the gate of the stack the same
charge gives 4.47 V, which is beyond the range of a follower on +-5 V."""

_PULSE_POINTS: Final = 200


@dataclass(frozen=True)
class Stimulus:
    """A source and the parameters of its run."""

    description: str
    source: str
    """Source in ngspice's syntax."""
    stop: float
    """End of the run [s]."""
    largest_step: float
    """Upper limit of the time step [s]."""


def _pulse(width: float, lead: float, stop: float) -> str:
    """Return a raised-cosine pulse of 5 N, `width` [s] wide at half height, with rest before and after it."""
    phase = np.linspace(0, 1, _PULSE_POINTS + 1)
    volts = 0.5 * PRESS_VOLTAGE * (1 - np.cos(2 * np.pi * phase))
    time: NDArray[np.float64] = lead + 2 * width * phase
    return ngspice.piecewise_linear(np.r_[0.0, time, stop], np.r_[0.0, volts[:-1], 0.0, 0.0])


def stimuli() -> dict[str, Stimulus]:
    """Return the stimuli by name."""
    return {
        "press": Stimulus("5 N press, raised cosine, 50 ms at half height", _pulse(0.05, 5e-3, 0.11), 0.11, 2e-4),
        "tap": Stimulus("5 N tap, raised cosine, 0.1 ms at half height", _pulse(1e-4, 1e-5, 2.2e-4), 2.2e-4, 4e-7),
        "sine": Stimulus("sine, 1 kHz, 1 V amplitude, two periods", "sin(0 1 1k)", 2e-3, 4e-6),
        "step": Stimulus(
            "step 0 to 1 V at 1 us, 10 ns edge",
            ngspice.piecewise_linear([0, 1e-6, 1.01e-6, 6e-6], [0, 0, 1, 1]),
            6e-6,
            1e-8,
        ),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Write all reference files into a folder; return the exit code."""
    parser = argparse.ArgumentParser(prog="reference_runs", description=__doc__)
    parser.add_argument("folder", type=Path, help="where to write, e.g. test/data/spice")
    folder = parser.parse_args(arguments).folder
    try:
        write_all(folder)
    except (ngspice.SpiceError, OSError) as error:
        print(f"reference_runs: {error}", file=sys.stderr)
        return 1
    return 0


def write_all(folder: Path) -> None:
    """Run every circuit and write NAME_STIMULUS.csv, NAME_ac.csv (follower) and NAME_open_loop.csv.

    Parameters
    ----------
    folder : Path
        Folder of the files; created if missing.

    Raises
    ------
    ngspice.SpiceError
        ngspice is missing or a run failed.
    OSError
        A file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for circuit in ngspice.CIRCUITS:
        text = ngspice.netlist(circuit)
        for name, stimulus in stimuli().items():
            run = ngspice.run_follower(text, stimulus.source, stimulus.stop, stimulus.largest_step)
            columns = np.c_[run.time, run.v_in, run.v_out]
            about = f"{stimulus.description}; steps of at most {stimulus.largest_step:g} s"
            _write(folder / f"{circuit}_{name}.csv", circuit, about, "time,v_in,v_out", columns)
        for name, about, response in (
            ("ac", "follower, small signals", ngspice.run_follower_ac(text, per_decade=20)),
            ("open_loop", "open loop, small signals", ngspice.run_open_loop_ac(text, per_decade=20)),
        ):
            columns = np.c_[response.frequency, response.transfer.real, response.transfer.imag]
            _write(folder / f"{circuit}_{name}.csv", circuit, about, "frequency,real,imaginary", columns)


def _write(path: Path, circuit: str, about: str, header: str, columns: NDArray[np.float64]) -> None:
    origin = (
        f"# {circuit}.cir of posfet_model/spice/netlists as a follower: {about}\n"
        f"# {version()}, gear, reltol {ngspice.RELATIVE_TOLERANCE:g}; "
        "made by python -m posfet_model.spice.reference_runs\n"
    )
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"{origin}{header}\n")
        np.savetxt(file, columns, delimiter=",", fmt="%.12g")


def version() -> str:
    """Return name and version of the ngspice on PATH; SpiceError when there is none."""
    if not ngspice.available():
        raise ngspice.SpiceError(f"{ngspice.PROGRAM} is not on PATH")
    answer = subprocess.run(
        [ngspice.PROGRAM, "--version"], capture_output=True, text=True, timeout=60, check=False
    ).stdout
    words = [word for word in answer.split() if word.startswith("ngspice-")]
    return words[0] if words else ngspice.PROGRAM


if __name__ == "__main__":
    sys.exit(main())
