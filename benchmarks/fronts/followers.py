# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Followers: models of the amplifier, and the circuit simulator at several tolerances, on press, tap, sine and step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.fronts import simulator
from benchmarks.fronts.front import Check, Choice, Effort, Front, order
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_model._lib.types import Array
from posfet_model.amplifier.closed_loop import ClosedLoop
from posfet_model.amplifier.follower import (
    IdealFollower,
    OnePoleFollower,
    StaticFollower,
    TwoPoleFollower,
)
from posfet_model.amplifier.follower_base import Follower
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.ringing_follower import RingingFollower
from posfet_model.amplifier.slew_identification import slew_model
from posfet_model.spice import ngspice
from posfet_model.spice.model_comparison import SECOND_POLE_QUALITY, deviation
from posfet_model.spice.reference_runs import PRESS_VOLTAGE, Stimulus, stimuli
from posfet_model.spice.run_file import FollowerRun

CIRCUIT = "opamp_b"
REFERENCE_TOLERANCE = 1e-5
"""Tolerance of the coarser of the two runs whose difference is the reference's uncertainty."""

TOLERANCES = (1e-5, 1e-4, 1e-3)
STEPS = {
    "press": (1e-5, 1e-4, 1e-3),
    "tap": (1e-7, 1e-6, 1e-5),
    "sine": (1e-7, 1e-6, 1e-5),
    "step": (1e-8, 3e-8, 1e-7),
}
"""Steps of the models [s] by input, from a tenth of the time constant or of a thousandth of the input on."""

SHORT = ("sine",)
SAME_INPUT = 2e-5
"""Largest difference of an input and its formula [V]: the chords of a pulse drawn with 200 points."""

LOOSE = 8
"""Largest step of ngspice over that of the reference, so that the tolerance decides about the step."""

IN_ONE = 6
"""Runs within one process of ngspice."""

MOST_SIMULATIONS = 3
"""Runs of ngspice that are timed, each a process."""

FREQUENCY, AMPLITUDES = 10e3, (0.05, 0.25)
"""Sines of an array: frequency [Hz] and first and last amplitude [V]."""

ARRAY_STEPS = (0.5e-6, 1e-6, 2e-6)
MANY = 64
"""Followers of the smaller array."""

ONE_POLE, LINEAR, SLEWING = "one pole", "two poles with a zero", "square-law slew"


@dataclass(frozen=True)
class Reference:
    """ngspice's run of one input at the tightest tolerance, and how well it is known."""

    run: FollowerRun
    uncertainty: float
    """Difference of a run with half the largest step and a tenth of the tolerance [% of full scale]."""
    stimulus: Stimulus


def measure(effort: Effort) -> list[Front]:
    """Return a front for each input, and one for arrays."""
    text = ngspice.netlist(CIRCUIT)
    loop = ngspice.closed_loop(ngspice.run_follower_ac(text, per_decade=20))
    models = _models(loop, text)
    names = SHORT if effort.short else tuple(STEPS)
    sizes = (8,) if effort.short else (MANY, 4096)
    singles = [_single(name, models, text, loop, effort) for name in names]
    return singles + [_arrays(size, loop, text, effort) for size in sizes]


def _models(loop: ClosedLoop, text: str) -> dict[str, Follower]:
    """Return the followers, all from the circuit's own small-signal analysis, none fitted to the runs."""
    return {
        "ideal": IdealFollower(),
        "static": StaticFollower(gain=loop.gain),
        ONE_POLE: OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth),
        "two poles": TwoPoleFollower.from_bandwidth(loop.gain, loop.bandwidth, SECOND_POLE_QUALITY),
        LINEAR: RingingFollower(open_loop=_open_loop(text)),
        SLEWING: slew_model(loop).follower(),
    }


def _open_loop(text: str) -> OpenLoop:
    """Return two poles and a zero, from gain, unity crossing and phase margin of the circuit."""
    found = ngspice.run_open_loop_ac(text, per_decade=50)
    crossing = int(np.flatnonzero(np.abs(found.transfer) >= 1)[-1])
    around = slice(crossing, crossing + 2)
    logs = np.log(np.abs(found.transfer[around]))
    part = float(logs[0] / (logs[0] - logs[1]))
    frequency = float(np.exp(np.interp(part, (0, 1), np.log(found.frequency[around]))))
    phase = float(np.interp(part, (0, 1), np.unwrap(np.angle(found.transfer[: crossing + 2]))[-2:]))
    return OpenLoop.from_phase_margin(abs(found.transfer[0]), frequency, 180 + math.degrees(phase))


def reference(name: str, text: str) -> Reference:
    """Run ngspice at the reference tolerance and, for its own uncertainty, once more finer."""
    stimulus = stimuli()[name]
    coarse, fine = (
        ngspice.run_follower(text, stimulus.source, stimulus.stop, stimulus.largest_step / cut, tolerance)
        for cut, tolerance in ((2, REFERENCE_TOLERANCE), (4, REFERENCE_TOLERANCE / 10))
    )
    run = FollowerRun(fine.time, fine.v_in, fine.v_out)
    difference = np.abs(coarse.v_out - np.interp(coarse.time, fine.time, fine.v_out)).max()
    return Reference(run, 100 * float(difference) / float(np.ptp(run.v_out)), stimulus)


def sampled(name: str, run: FollowerRun, step: float) -> tuple[Array, Array]:
    """Return instants [s] and the input at them [V]."""
    instants = np.arange(0.0, run.time[-1] * (1 + 1e-9), step)
    exact = formula(name, instants) if name == "sine" else np.interp(instants, run.time, run.v_in)
    return instants, exact


def formula(name: str, time: Array) -> Array:
    """Return the input [V] by its definition, independent of the simulator's source."""
    if name == "sine":
        return np.asarray(np.sin(2 * np.pi * 1e3 * time))
    if name == "step":
        return np.clip((time - 1e-6) / 1e-8, 0.0, 1.0)
    width, lead = {"press": (0.05, 5e-3), "tap": (1e-4, 1e-5)}[name]
    phase = np.clip((time - lead) / (2 * width), 0.0, 1.0)
    return np.asarray(0.5 * PRESS_VOLTAGE * (1 - np.cos(2 * np.pi * phase)))


def error_percent(model: Follower, name: str, run: FollowerRun, step: float) -> float:
    """Return the largest error at the model's own instants [% of full scale], the first values subtracted."""
    instants, v_in = sampled(name, run, step)
    found = model.run(instants, v_in).v_out
    wanted = np.interp(instants, run.time, run.v_out)
    return 100 * float(np.abs((found - found[0]) - (wanted - wanted[0])).max()) / float(np.ptp(run.v_out))


def _single(name: str, models: dict[str, Follower], text: str, loop: ClosedLoop, effort: Effort) -> Front:
    known = reference(name, text)
    run, stop = known.run, known.stimulus.stop
    calls = {}
    for title, model in models.items():
        for step in STEPS[name]:
            inputs = sampled(name, run, step)
            calls[f"{title}|{step:g}"] = lambda model=model, inputs=inputs: model.run(*inputs)
    seconds = interleaved(calls, effort.repeats)
    choices = [
        Choice(title, _step(step), error_percent(model, name, run, step), seconds[f"{title}|{step:g}"])
        for title, model in models.items()
        for step in STEPS[name]
    ]
    choices += _circuit_simulator(known, text, effort)
    fine = STEPS[name][0]
    errors = {choice.name: choice.error for choice in choices}
    uneven = deviation(run, models[ONE_POLE]).max_pct
    inputs = float(np.abs(run.v_in - formula(name, run.time)).max())
    checks = (
        Check("input of the reference against its formula [V]", inputs, 0.0, SAME_INPUT),
        Check("end of the model's run over that of the reference [1]",
              sampled(name, run, fine)[0][-1] / run.time[-1], 1 - 1e-3, 1 + 1e-9),
        Check(f"one pole at {_step(fine)} over one pole at the reference's own instants [1]",
              errors[f"{ONE_POLE}, {_step(fine)}"] / max(uneven, known.uncertainty), 0.8, 1.2),
        *(_order_checks(models[ONE_POLE], loop) if name == "sine" else ()),
        Check("reference's uncertainty over the smallest error of a model [1]",
              known.uncertainty / min(each.error for each in choices if each.series in models), 0.0, 1.0),
    )  # fmt: skip
    shipped = f"{ONE_POLE}, {_step(STEPS[name][-1])}"
    return Front(
        f"follower_{name}",
        f"Follower, {name}",
        f"{known.stimulus.description}, {shown(stop * 1e3)} ms, one follower",
        "largest error [% of full scale]",
        f"ngspice, netlist {CIRCUIT}, reltol {REFERENCE_TOLERANCE / 10:g}",
        known.uncertainty,
        tuple(choices),
        shipped,
        checks,
        _reading(name, choices, shipped),
        why_not="It is better on this input alone; the board has one model for every input, exact for any step, which "
        "needs gain and bandwidth alone.",
        question="the amplifier of one taxel" if name == "press" else "",
        rival=f"ngspice, reltol {TOLERANCES[-1]:g}" if name == "press" else "",
    )


def _reading(name: str, choices: Sequence[Choice], shipped: str) -> str:
    own = next(each for each in choices if each.name == shipped)
    simulator = min((each for each in choices if each.series == "ngspice"), key=lambda each: each.error)
    best = min((each for each in choices if each.series != "ngspice"), key=lambda each: each.error)
    return (
        f"On a {name}, one pole at its longest step is within {shown(own.error)} % of the circuit in "
        f"{shown(own.median / simulator.median)} of the run time of ngspice at {simulator.parameter}. "
        f"The smallest error of a closed-form model is {shown(best.error)} % ({best.name}): choose that where the "
        "shape of the transient matters, one pole for everything sampled at the scan rate."
    )


def _order_checks(model: Follower, loop: ClosedLoop) -> tuple[Check, ...]:
    """Check the first-order hold on a sine whose exact response is known: order 2, and size, of its error."""
    tau, omega = 1 / (2 * math.pi * loop.bandwidth), 2 * math.pi * 1e5
    steps = [tau / 4, tau / 8, tau / 16, tau / 32]
    errors = []
    for step in steps:
        instants = np.arange(0, 4e-5, step)
        found = model.run(instants, np.sin(omega * instants)).v_out
        exact = loop.gain * (
            (np.sin(omega * instants) - omega * tau * np.cos(omega * instants) + omega * tau * np.exp(-instants / tau))
            / (1 + (omega * tau) ** 2)
        )
        errors.append(float(np.abs(found - exact)[len(instants) // 2 :].max()))
    theory = loop.gain * (omega * steps[-1]) ** 2 / 12 / math.hypot(1.0, omega * tau)
    return (
        Check("order of the first-order hold", order(steps, errors), 1.95, 2.05),
        Check("its error at the finest step over (omega*h)^2/12 after one pole", errors[-1] / theory, 0.95, 1.05),
    )


def _circuit_simulator(known: Reference, text: str, effort: Effort) -> list[Choice]:
    """Return ngspice at several tolerances."""
    found, stimulus = [], known.stimulus
    largest = LOOSE * stimulus.largest_step
    for tolerance in TOLERANCES:
        runs = [
            simulator.transient(text, [stimulus.source], stimulus.stop, largest, tolerance, IN_ONE)
            for _ in range(min(effort.repeats, MOST_SIMULATIONS))
        ]
        run = runs[0][0]
        wanted = np.interp(run.time, known.run.time, known.run.v_out)
        error = 100 * float(np.abs(run.v_out - wanted).max()) / float(np.ptp(known.run.v_out))
        found.append(Choice("ngspice", f"reltol {tolerance:g}", error, tuple(seconds for _, seconds in runs)))
    return found


def _step(step: float) -> str:
    for unit, size in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if step >= 0.999 * size:
            return f"{step / size:.3g} {unit}"
    return f"{step:g} s"


def _arrays(taxels: int, loop: ClosedLoop, text: str, effort: Effort) -> Front:
    """Return models and ngspice for many followers with sines of different amplitude."""
    one, model_steps = OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth), ARRAY_STEPS
    models = {"static": StaticFollower(gain=loop.gain), ONE_POLE: one}
    models["two poles"] = TwoPoleFollower.from_bandwidth(loop.gain, loop.bandwidth, SECOND_POLE_QUALITY)
    amplitudes = np.linspace(*AMPLITUDES, taxels)
    stop = (0.3 if taxels > MANY or effort.short else 1.0) / FREQUENCY
    fine, finer = (
        simulator.transient(text, [_sine(AMPLITUDES[1])], stop, model_steps[0] / cut, REFERENCE_TOLERANCE / 10)[0]
        for cut in (10, 20)
    )
    scale = 100 / float(np.ptp(finer.v_out))
    uncertainty = scale * float(np.abs(fine.v_out - np.interp(fine.time, finer.time, finer.v_out)).max())
    choices, calls, errors = [], {}, {}
    for title, model in models.items():
        for step in model_steps:
            instants = np.arange(0, stop * (1 + 1e-9), step)
            v_in = amplitudes * np.sin(2 * np.pi * FREQUENCY * instants)[:, None]
            wanted = np.interp(instants, finer.time, finer.v_out)
            name = f"{title}, {_step(step)}"
            found = model.run(instants, v_in).v_out[:, -1]
            errors[name] = scale * float(np.abs(found - wanted + wanted[0]).max())
            calls[name] = lambda model=model, instants=instants, v_in=v_in: model.run(instants, v_in)
    for name, seconds in interleaved(calls, effort.repeats).items():
        choices.append(Choice(*name.split(", "), errors[name], tuple(each / stop / taxels for each in seconds)))
    for tolerance in TOLERANCES[1:]:
        runs = [
            simulator.transient(
                text,
                [_sine(each) for each in amplitudes],
                stop,
                model_steps[-1],
                tolerance,
                1 if taxels > MANY else IN_ONE,
            )
            for _ in range(1 if taxels > MANY else min(effort.repeats, MOST_SIMULATIONS))
        ]
        run = runs[0][0]
        error = scale * float(np.abs(run.v_out - np.interp(run.time, finer.time, finer.v_out)).max())
        each = tuple(seconds / stop / taxels for _, seconds in runs)
        choices.append(Choice("ngspice", f"reltol {tolerance:g}", error, each))
    shipped = f"{ONE_POLE}, {_step(model_steps[-1])}"
    instants = np.arange(0, stop * (1 + 1e-9), model_steps[-1])
    alone = one.run(instants, AMPLITUDES[1] * np.sin(2 * np.pi * FREQUENCY * instants)).v_out
    wanted = np.interp(instants, finer.time, finer.v_out)
    by_itself = scale * float(np.abs(alone - wanted + wanted[0]).max())
    own = next(each for each in choices if each.name == shipped)
    other = min((each for each in choices if each.series == "ngspice"), key=lambda each: each.median)
    checks = (
        Check("error of the last follower over that of the same follower alone [1]", own.error / by_itself,
              1 - 1e-9, 1 + 1e-9),
        Check("input of ngspice against that of the model [V]", float(np.abs(
            finer.v_in - AMPLITUDES[1] * np.sin(2 * np.pi * FREQUENCY * finer.time)).max()), 0.0, 1e-6),
        Check("reference's uncertainty over the error of one pole [1]", uncertainty / own.error, 0.0, 0.5),
    )  # fmt: skip
    return Front(
        f"follower_array_{taxels}",
        f"{taxels} followers",
        f"1 s of one of {taxels} followers",
        "largest error of the last follower [% of full scale]",
        f"ngspice, one follower, reltol {REFERENCE_TOLERANCE / 10:g}, a twentieth of the smallest step",
        uncertainty,
        tuple(choices),
        shipped,
        checks,
        f"Of {taxels} followers one pole costs {shown(own.median / other.median)} of what ngspice costs at "
        f"{other.parameter}, with {shown(own.error)} % of error. Simulate arrays with the model, and a circuit of "
        "which each transistor matters with ngspice.",
        why_not="It leaves out the lag, which is small at this frequency and does not show in the cost of a scan.",
        question=f"the amplifiers of {taxels} taxels" if taxels > MANY else "",
        rival=other.name if taxels > MANY else "",
    )


def _sine(amplitude: float) -> str:
    return f"sin(0 {amplitude:.12g} {FREQUENCY:.12g})"
