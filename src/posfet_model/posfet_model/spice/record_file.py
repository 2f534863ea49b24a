# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Files of recorded runs in ngspice, NAME.npz: times as float32, outputs in 65535 levels of their range."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.amplifier.transistor_point import TransistorPoint
from posfet_model.spice.measurement import BiasPoint, LoopMeasurement

_LEVELS: Final = 65535


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """One transient run."""

    time: NDArray[np.float64]
    """[s]."""
    v_out: NDArray[np.float64]
    """Output [V]; straight between the instants."""
    uncertainty: float
    """Rms change with half the tolerance and half the largest step [% of full scale]."""


@dataclass(frozen=True, eq=False)
class Record:
    """What ngspice says about a circuit."""

    circuit: str
    """Name of the circuit."""
    simulator: str
    """Name and version."""
    deck_hash: str
    """Of netlist, options and inputs: `deck_hash` of the circuit now."""
    loop: LoopMeasurement
    """Loop gain in numbers, with a voltage source in the loop."""
    exact_loop: LoopMeasurement
    """Loop gain in numbers, with a voltage and a current in the loop, exact for any load by the inverting input."""
    open_loop: LoopMeasurement
    """Gain of the op-amp in numbers, without the inverting input as a load of the output."""
    bias_point: BiasPoint
    """Operating point."""
    frequency: NDArray[np.float64]
    """Of the loop gain [Hz], to ten times the unity crossing."""
    loop_gain: NDArray[np.complex128]
    """[V/V]."""
    follower_gain: float
    """Gain of the follower at low frequency [V/V]."""
    bandwidth: float
    """Frequency at which the gain of the follower has fallen by 3 dB [Hz]; NaN where unstable."""
    slew_rates: tuple[float, float]
    """Rise and fall as of `step_test.slew_rates`, on a step that no model is compared on [V/s]; NaN where unstable."""
    runs: Mapping[str, RecordedRun]
    """By name of the stimulus."""
    unstable: tuple[str, ...] = ()
    """Names of the stimuli in whose range the circuit is unstable, of which there are no runs."""


def save(path: Path, recorded: Record) -> None:
    """Write a record; times as float32, outputs in 65535 levels of each run's range.

    Parameters
    ----------
    path : Path
        The file, .npz.
    recorded : Record
        What to write.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    about: dict[str, Any] = {
        name: getattr(recorded, name) for name in ("circuit", "simulator", "deck_hash", "follower_gain", "unstable")
    }
    about |= {name: asdict(getattr(recorded, name)) for name in ("loop", "exact_loop", "open_loop", "bias_point")}
    about["bandwidth"] = None if math.isnan(recorded.bandwidth) else recorded.bandwidth
    about["slew_rates"] = [None if math.isnan(rate) else rate for rate in recorded.slew_rates]
    about["runs"] = {
        name: {
            "samples": run.time.size,
            "low": float(run.v_out.min()),
            "high": float(run.v_out.max()),
            "uncertainty": float(f"{run.uncertainty:.3g}"),
        }
        for name, run in recorded.runs.items()
    }
    levels = [(run.v_out - run.v_out.min()) / np.ptp(run.v_out) * _LEVELS for run in recorded.runs.values()]
    np.savez_compressed(
        path,
        about=np.array(json.dumps(about)),
        frequency=recorded.frequency.astype(np.float32),
        loop_gain=recorded.loop_gain.astype(np.complex64),
        time=np.concatenate([[], *(run.time for run in recorded.runs.values())]).astype(np.float32),
        v_out=np.round(np.concatenate([[], *levels])).astype(np.uint16),
    )


def load(path: Path) -> Record:
    """Read a record.

    Parameters
    ----------
    path : Path
        The file, from `save`.

    Returns
    -------
    Record
        What it contains.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no record.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            time, levels = file["time"].astype(np.float64), file["v_out"].astype(np.float64)
            frequency, loop_gain = file["frequency"].astype(np.float64), file["loop_gain"].astype(np.complex128)
        points = {name: TransistorPoint(**point) for name, point in about["bias_point"]["transistors"].items()}
        ends = np.cumsum([run["samples"] for run in about["runs"].values()])
        return Record(
            circuit=about["circuit"],
            simulator=about["simulator"],
            deck_hash=about["deck_hash"],
            loop=LoopMeasurement(**about["loop"]),
            exact_loop=LoopMeasurement(**about["exact_loop"]),
            open_loop=LoopMeasurement(**about["open_loop"]),
            bias_point=BiasPoint(about["bias_point"]["v_out"], points),
            frequency=frequency,
            loop_gain=loop_gain,
            follower_gain=about["follower_gain"],
            bandwidth=math.nan if about["bandwidth"] is None else about["bandwidth"],
            unstable=tuple(about["unstable"]),
            slew_rates=tuple(math.nan if rate is None else rate for rate in about["slew_rates"]),  # type: ignore[arg-type]
            runs={
                name: RecordedRun(
                    time[end - run["samples"] : end],
                    run["low"] + (run["high"] - run["low"]) / _LEVELS * levels[end - run["samples"] : end],
                    run["uncertainty"],
                )
                for (name, run), end in zip(about["runs"].items(), ends, strict=True)
            },
        )
    except (KeyError, TypeError, EOFError) as error:
        raise ValueError(f"{path}: is no record of a circuit") from error
