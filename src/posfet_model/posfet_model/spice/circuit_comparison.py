# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Errors of the follower models on the set of circuits, and whether they meet the targets.

The targets are the same for every circuit. A run that the model itself declares not valid still counts as missed where
its error is above the target; it is shown apart from those that are missed without warning.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.amplifier.open_loop import LEAST_PHASE_MARGIN, MOST_OVERSHOOT
from posfet_model.amplifier.step_test import mean_slope
from posfet_model.spice.circuit_models import WAYS, CircuitModel
from posfet_model.spice.circuits import Circuit
from posfet_model.spice.measurement import overshoot
from posfet_model.spice.record_file import Record
from posfet_model.spice.recorded_runs import time_scale
from posfet_model.spice.stimuli import Stimulus, stimuli

SMALL_STEP: Final = 0.05
"""Largest step [V] that counts as small."""

STEP_TARGETS: Final = {"given": (0.5, 0.5), "measured": (0.5, 0.5), "calibrated": (0.5, 0.5)}
"""Largest rms error of small and of other steps by the way to obtain the model [% of full scale]."""

OTHER_STEP_TARGETS: Final = (1.0, 1.5)
"""The same for all other ways."""

SLOW_TARGET: Final = 0.1
"""Largest rms error of press, tap and sines [% of full scale]."""

LOOP_TARGETS: Final = {"phase_margin": 5.0, "unity_crossing": 10.0, "overshoot": 3.0}
"""Largest error of the phase margin [degrees], of the unity crossing [%], of the overshoot of 50 mV [% of the step]."""

OVERSHOOT_STEP: Final = "up_50_mv"
SLEWING_STEP: Final = "up_1000_mv"  # 1 V


@dataclass(frozen=True)
class RunError:
    """Error of a model on a run."""

    circuit: str
    way: str
    stimulus: str
    max_pct: float
    """Largest error [% of full scale]."""
    rms_pct: float
    """Rms error over time [% of full scale]."""
    target_pct: float
    """Largest rms error allowed [% of full scale]."""
    reference_pct: float
    """Uncertainty of the reference [% of full scale]."""
    valid: bool
    """Whether the model declares the whole run valid."""

    @property
    def met(self) -> bool:
        """Whether the target is met."""
        return self.rms_pct <= self.target_pct


@dataclass(frozen=True)
class LoopError:
    """Loop gain and step response by ngspice and by a model, as pairs (ngspice, model)."""

    circuit: str
    way: str
    gain_db: tuple[float, float]
    """A0 [dB]."""
    unity_crossing: tuple[float, float]
    """[Hz]."""
    phase_margin: tuple[float, float]
    """[degrees]."""
    overshoot: tuple[float, float]
    """Of a step of 50 mV upwards, in runs [1]; NaN where unstable."""
    slew_rate: tuple[float, float]
    """Of a step of 1 V upwards [V/s]."""
    stable: tuple[bool, bool]
    """Whether the follower is stable."""
    usable: tuple[bool, bool]
    """Whether it is stable with a phase margin of 45 degrees and at most 10 % of overshoot."""

    def errors(self) -> dict[str, float]:
        """Return the errors that have targets; none where the circuit is unstable."""
        if not self.stable[0]:
            return {}
        return {
            "phase_margin": self.phase_margin[1] - self.phase_margin[0],
            "unity_crossing": 100 * (self.unity_crossing[1] / self.unity_crossing[0] - 1),
            "overshoot": 100 * (self.overshoot[1] - self.overshoot[0]),
        }

    def misses(self) -> list[str]:
        """Return what misses its target, in words."""
        found = [
            f"{name.replace('_', ' ')} {error:+.1f} (at most {LOOP_TARGETS[name]:g})"
            for name, error in self.errors().items()
            if not abs(error) <= LOOP_TARGETS[name]
        ]
        if self.stable[0] != self.stable[1]:
            found.append(f"is {_stability(self.stable[0])}, the model says {_stability(self.stable[1])}")
        return found


@dataclass(frozen=True)
class Comparison:
    """All errors of a circuit and one way to obtain its model."""

    loop: LoopError
    runs: tuple[RunError, ...]
    wrongly_valid: tuple[str, ...]
    """Runs that the model declares valid though the circuit is unstable in the range of their input."""

    def misses(self) -> list[str]:
        """Return what misses its target, in words; empty if all is met."""
        runs = [
            f"{run.stimulus} rms {run.rms_pct:.2f} % (at most {run.target_pct:g}){'' if run.valid else ', not valid'}"
            for run in self.runs
            if not run.met
        ]
        return [
            *self.loop.misses(),
            *runs,
            *(f"{name} valid where the circuit is unstable" for name in self.wrongly_valid),
        ]


def _stability(stable: bool) -> str:
    return "stable" if stable else "unstable"


def step_target(way: str, volts: float) -> float:
    """Return the largest rms error of a step [% of full scale]; unchecked.

    Parameters
    ----------
    way : str
        Way to obtain the model.
    volts : float
        Height of the step [V].
    """
    small, large = STEP_TARGETS.get(way, OTHER_STEP_TARGETS)
    return small if volts <= SMALL_STEP else large


@dataclass(frozen=True, eq=False)
class _ModelRun:
    """A model's output on a stimulus."""

    time: NDArray[np.float64]
    v_out: NDArray[np.float64]
    valid: bool


def _model_run(model: CircuitModel, stimulus: Stimulus, instants: NDArray[np.float64]) -> _ModelRun:
    """Return the output at the stimulus' own instants and others, and whether it is valid throughout."""
    time, v_in = stimulus.resolved()
    everywhere = np.union1d(time, instants[instants < stimulus.stop])
    output = model.follower.run(everywhere, np.interp(everywhere, time, v_in))
    return _ModelRun(everywhere, output.v_out, model.usable and bool(output.valid.all()))


def compare(circuit: Circuit, record: Record, way: str) -> Comparison:
    """Return the errors of the model that is obtained in one way.

    Parameters
    ----------
    circuit : Circuit
        The circuit.
    record : Record
        ngspice's runs of it.
    way : str
        One of `circuit_models.WAYS`.

    Returns
    -------
    Comparison
        The errors.
    """
    model = WAYS[way](circuit, record)
    inputs = stimuli(circuit, time_scale(record.loop))
    found = {name: _model_run(model, inputs[name], run.time) for name, run in record.runs.items()}
    errors = tuple(_run_error(record, way, name, inputs[name], run) for name, run in found.items())
    nothing = np.zeros(0)
    wrongly_valid = (
        tuple(name for name in record.unstable if _model_run(model, inputs[name], nothing).valid)
        if model.usable
        else ()
    )
    return Comparison(_loop_error(record, way, model, found), errors, wrongly_valid)


def _run_error(record: Record, way: str, name: str, stimulus: Stimulus, found: _ModelRun) -> RunError:
    """Return the error of a model on a recorded run; first values are subtracted."""
    run = record.runs[name]
    error = (found.v_out - found.v_out[0]) - (np.interp(found.time, run.time, run.v_out) - run.v_out[0])
    scale = 100 / float(np.ptp(run.v_out))
    square = 0.5 * (error[1:] ** 2 + error[:-1] ** 2) * np.diff(found.time)
    slow = stimulus.kind not in ("up", "down")
    return RunError(
        circuit=record.circuit,
        way=way,
        stimulus=name,
        max_pct=scale * float(np.max(np.abs(error))),
        rms_pct=scale * math.sqrt(float(square.sum()) / stimulus.stop),
        target_pct=SLOW_TARGET if slow else step_target(way, stimulus.amplitude),
        reference_pct=run.uncertainty,
        valid=found.valid,
    )


def _loop_error(record: Record, way: str, model: CircuitModel, found: Mapping[str, _ModelRun]) -> LoopError:
    """Return loop gain and step response by ngspice and by a model."""
    measured = record.exact_loop
    stable = measured.stable, model.stable
    gains = measured.gain / (1 + measured.gain), model.closed_loop_gain
    peaks = slopes = (math.nan, math.nan)
    if all(stable) and OVERSHOOT_STEP in found:
        curves = (record.runs[OVERSHOOT_STEP].v_out, found[OVERSHOOT_STEP].v_out)
        ends = [float(curve[0]) + SMALL_STEP * gain for curve, gain in zip(curves, gains, strict=True)]
        peaks = overshoot(curves[0], ends[0]), overshoot(curves[1], ends[1])
    if all(stable) and SLEWING_STEP in found:
        run, own = record.runs[SLEWING_STEP], found[SLEWING_STEP]
        ends = [float(run.v_out[0]) + gains[0], float(own.v_out[0]) + gains[1]]
        slopes = mean_slope(run.time, run.v_out, ends[0]), mean_slope(own.time, own.v_out, ends[1])
    usable = measured.phase_margin >= LEAST_PHASE_MARGIN and peaks[0] <= MOST_OVERSHOOT
    return LoopError(
        circuit=record.circuit,
        way=way,
        gain_db=(measured.gain_db, 20 * math.log10(model.gain)),
        unity_crossing=(measured.unity_crossing, model.unity_crossing),
        phase_margin=(measured.phase_margin, model.phase_margin),
        overshoot=peaks,
        slew_rate=slopes,
        stable=stable,
        usable=(bool(usable), model.usable),
    )


def compare_all(
    circuits: Mapping[str, Circuit], records: Callable[[Circuit], Record], ways: Mapping[str, object] = WAYS
) -> Iterator[Comparison]:
    """Yield the comparison of every circuit with every way to obtain its model.

    Parameters
    ----------
    circuits : mapping of str to Circuit
        The circuits.
    records : callable
        Returns ngspice's runs of a circuit.
    ways : mapping, default WAYS
        Names of the ways.

    Yields
    ------
    Comparison
        The errors.
    """
    for circuit in circuits.values():
        record = records(circuit)
        for way in ways:
            yield compare(circuit, record, way)
