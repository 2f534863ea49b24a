# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Followers that are integrated with an error bound: an op-amp circuit from sizes and bias, and a loop that slews.

`CircuitFollower` is the circuit itself (`circuit`): it rings, slews at different rates up and down, cuts its output
stage off and runs into its rails as the circuit does, and says so. `SlewingFollower` knows only gain, poles, zero and
slew rate. Both take any step; the error bound chooses the sub-steps (`transient`).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import instance, real_array, real_number
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import CircuitFigures, circuit_figures
from posfet_model.amplifier.follower_base import (
    STEP_LIMIT,
    Follower,
    FollowerOutput,
    FollowerSeries,
    FollowerState,
    FrequencyResponse,
    check_shape,
)
from posfet_model.amplifier.input_findings import LOW_MARGIN_HERE, POINTS, RINGS_HERE, input_findings
from posfet_model.amplifier.open_loop import LOW_MARGIN, RINGS, UNSTABLE, OpenLoop
from posfet_model.amplifier.operating_point import CIRCUIT_B, TABLE_II, AmplifierBias, AmplifierDesign
from posfet_model.amplifier.pair_loop import PairLoop
from posfet_model.amplifier.parallel_in_time import LEAST_INTERVALS, advance_stretches
from posfet_model.amplifier.transient import TOLERANCE, System, SystemState, advance, advance_through
from posfet_model.amplifier.undetermined import (
    INPUTS_NOT_GIVEN,
    NEAR_REST,
    POLES_NOT_GIVEN,
    check_known_inputs,
    undetermined,
)
from posfet_model.amplifier.validity import Validity

LOST: Final = "no output: the circuit does not settle, or did not before"

STRAIGHTNESS: Final = 0.01
"""Largest deviation of samples of the input from a straight line that is integrated as one [tolerance]."""

SHORTEST_HOLD: Final = 3.0
"""Least duration of a step, in periods of the unity crossing, at whose end no transient is left."""

ROWS_PER_INTERVAL: Final = 10
"""Samples that are integrated in stretches of time in the duration of one interval in sequence."""

OSCILLATION: Final = 0.01
"""Error bound of a sub-step of an unstable follower in addition, as a share of the change of its nodes: no result is
valid, and frequency and swing of the oscillation are right to 0.1 % and some mV with an eighth of the sub-steps."""

LONG_RUN: Final = 0.1
"""Error bound of a step that passes samples [tolerance]: ends at each sample would have made steps shorter."""


def _straight(start: Array, held: Array, step: Array, begin: int, deviation: float) -> int:
    """Return the end of a run of steps in which the input [V] deviates so little from a straight line: one at least."""

    def fits(count: int) -> bool:
        steps, volts = step[begin : begin + count], held[begin : begin + count]
        if steps.size < count or not steps.all():
            return False
        share = np.cumsum(steps).reshape(-1, *(1,) * start.ndim)
        return bool(np.abs(volts - start - (volts[-1] - start) * (share / share[-1])).max() <= deviation)

    good, bad = 1, 2
    while fits(bad):
        good, bad = bad, 2 * bad
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if fits(middle) else (good, middle)
    return begin + good


@dataclass(frozen=True, eq=False)
class TransientState(FollowerState):
    """State of an integrated follower; `lags` are those of the output alone."""

    nodes: Array
    """Voltages of the system's nodes [V], shape [..., n]."""
    step: float
    """Sub-step that the error bound allowed last [s]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TransientFollower(Follower):
    """Base class: a follower whose equations are integrated, its input at the limits clipped as everywhere."""

    tolerance: float = TOLERANCE
    """Error bound of a sub-step [V], in [1e-9, 0.1]."""
    poles_known: bool = True
    """Whether second pole and zero are those of the op-amp; if not, results are not valid where they matter."""
    full_scale: float | None = None
    """Span of the whole input [V], in [0, 2e6], to which that refers; None: of the inputs that are given at once."""
    known_inputs: tuple[float, float] = NEAR_REST
    """Inputs [V], from one in [-1e6, 0] to one in [0, 1e6], at which the op-amp is known to be stable and in its range;
    where its poles are not known, results at others are not valid."""

    def __post_init__(self) -> None:
        super().__post_init__()
        real_number("tolerance", self.tolerance, 1e-9, 0.1)
        instance("poles_known", self.poles_known, bool)
        if self.full_scale is not None:
            real_number("full_scale", self.full_scale, 0, 2e6)
        check_known_inputs(self.known_inputs)

    @property
    @abstractmethod
    def system(self) -> System:
        """What is integrated."""

    @abstractmethod
    def _closed_loop_response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex gain of the follower for small signals at frequencies [Hz]."""

    @property
    @abstractmethod
    def validity(self) -> Validity:
        """Whether the follower is usable at all, and why not."""

    @property
    @abstractmethod
    def _crossing(self) -> float | Array:
        """Unity crossing [Hz]."""

    def start(self, v_in: ArrayLike) -> TransientState:
        """Return the state at rest at an input voltage.

        Parameters
        ----------
        v_in : array_like
            Input voltage [V], any shape with which the follower's own broadcasts to it, within +-1e6.

        Returns
        -------
        TransientState
            The state, of the shape of `v_in`.

        Raises
        ------
        ValueError
            The voltage is not real, not finite, out of range or of another shape.
        """
        held, valid = self._hold(v_in)
        check_shape(self.system.shape, held)
        return self._state(held, valid, self.system.operating_point(held), math.inf)

    def advance(self, state: FollowerState, v_in: ArrayLike, step: ArrayLike) -> TransientState:
        """Return the state after one step in which the input changed linearly.

        Parameters
        ----------
        state : TransientState
            State at the start of the step.
        v_in : array_like
            Input voltage at the end of the step [V], of the state's shape.
        step : array_like
            Length of the step [s], in [0, 1e9], a number.

        Returns
        -------
        TransientState
            State at the end of the step.

        Raises
        ------
        ValueError
            An argument is not real, not finite, out of range or of another shape.
        """
        before = instance("state", state, TransientState)
        held, valid = self._hold(v_in)
        duration = real_number("step", step, 0, STEP_LIMIT)  # type: ignore[arg-type]  # refuses what is none
        if held.shape != before.v_in.shape:
            raise ValueError(f"v_in must have the state's shape {before.v_in.shape}, got {held.shape}")
        after = advance(
            self.system,
            SystemState(before.v_in, before.nodes, before.step),
            held,
            duration,
            self.tolerance,
            self._share,
        )
        return self._state(held, valid, after.nodes, after.step)

    def response(self, frequency: ArrayLike) -> FrequencyResponse:
        """Return the small-signal gain and phase, with the input at 0 V.

        Parameters
        ----------
        frequency : array_like
            f [Hz], any shape, in [0, 1e18]; broadcasts with the follower.

        Returns
        -------
        FrequencyResponse
            Gain [V/V] and phase [rad].

        Raises
        ------
        ValueError
            A frequency is not real, not finite or out of range.
        """
        transfer = self._closed_loop_response(frequency)
        return FrequencyResponse(
            gain=np.abs(transfer), phase=np.angle(transfer), valid=np.broadcast_to(self.validity.valid, transfer.shape)
        )

    def _follow(
        self, state: FollowerState, held: NDArray[np.float64], valid: NDArray[np.bool_], step: NDArray[np.float64]
    ) -> FollowerSeries:
        before = instance("state", state, TransientState)
        nodes, last = self._integrate(SystemState(before.v_in, before.nodes, before.step), held, step)
        output = self._judged(held, valid, nodes, step[1:])
        return FollowerSeries(output, self._state(held[-1], np.asarray(valid[-1]), last.nodes, last.step))

    def _run(self, held: Array, valid: Mask, step: Array) -> FollowerOutput:
        check_shape(self.system.shape, held[0])
        rest = self.system.operating_point(held[0])
        nodes, _ = self._integrate(SystemState(held[0], rest, math.inf), held[1:], step)
        return self._judged(held, valid, np.concatenate([rest[None], nodes]), step)

    def _integrate(self, now: SystemState, held: Array, step: Array) -> tuple[Array, SystemState]:
        nodes, following = self._following(now, held, step)
        begin = together = 0
        while begin < step.size:
            if following[begin]:
                now = SystemState(held[begin], nodes[begin], now.step)
                begin += 1
                continue
            if begin >= together:
                together = begin + int(np.argmax(np.append(following[begin:], True)))
                part = slice(begin, together)
                if held.ndim == 1 and self._steady and self._curved(now.v_in, held[part], step[part]):
                    run = advance_stretches(self.system, now, held[part], step[part], self.tolerance)
                    if run is not None:
                        now, nodes[begin : begin + len(run[1])] = run
                        begin += len(run[1])
                        continue
            end = _straight(now.v_in, held, step, begin, STRAIGHTNESS * self.tolerance)
            if step[begin] == 0:
                now = advance(self.system, now, held[begin], 0.0, self.tolerance)
                nodes[begin] = now.nodes
            else:
                times = np.cumsum(step[begin:end])
                bound = self.tolerance * (LONG_RUN if times.size > 1 else 1.0)
                now, nodes[begin:end] = advance_through(self.system, now, held[end - 1], times, bound, self._share)
            begin = end
        return nodes, now

    @property
    def _steady(self) -> bool:
        """Whether a follower of no shape forgets where it came from."""
        return bool(np.all(self.validity.findings.get(UNSTABLE, False) == np.False_))

    @property
    def _share(self) -> float:
        """Error bound relative to the change in a sub-step [1]."""
        return OSCILLATION if np.all(self.validity.findings.get(UNSTABLE, False)) else 0.0

    def _curved(self, start: Array, held: Array, step: Array) -> bool:
        """Return whether the input [V] has corners at so many samples that stretches of time are worth it."""
        if held.size < LEAST_INTERVALS:
            return False
        volts, time = np.concatenate([[start], held]), np.concatenate([[0.0], np.cumsum(step)])
        share = step[:-1] / np.maximum(time[2:] - time[:-2], np.finfo(float).tiny)
        bend = np.abs(volts[1:-1] - volts[:-2] - (volts[2:] - volts[:-2]) * share)
        return bool(ROWS_PER_INTERVAL * np.count_nonzero(bend > STRAIGHTNESS * self.tolerance) >= held.size)

    def _following(self, now: SystemState, held: Array, step: Array) -> tuple[Array, Mask]:
        """Return nodes [t, ..., n], and at which samples [t] they are those of an input that changes slowly."""
        del step
        return np.empty((*held.shape, now.nodes.shape[-1])), np.zeros(len(held), np.bool_)

    def _findings(self, nodes: Array, held: Array) -> dict[str, Mask]:
        """Return why results at these nodes and inputs are not valid, beside what holds always."""
        del nodes, held
        return {}

    def _judged(self, held: Array, valid: Mask, nodes: Array, step: Array | None = None) -> FollowerOutput:
        out = self.system.output(nodes)
        findings = {**self.validity.findings, **self._findings(nodes, held), LOST: ~np.isfinite(out)}
        if not self.poles_known:
            span = np.ptp(held) if self.full_scale is None and held.size else self.full_scale or 0.0
            findings[POLES_NOT_GIVEN] = undetermined(out - self._at_rest(held), span, step, self._crossing)
            findings[INPUTS_NOT_GIVEN] = (held < self.known_inputs[0]) | (held > self.known_inputs[1])
        shown = {reason: np.broadcast_to(mask, held.shape) for reason, mask in findings.items() if np.any(mask)}
        for mask in shown.values():
            valid = valid & ~mask
        return FollowerOutput(v_out=out, valid=np.asarray(valid & np.isfinite(out)), findings=shown)

    def _at_rest(self, held: Array) -> Array:
        """Return the output at rest at each input [V], of many by interpolation."""
        if self.system.shape or held.size <= POINTS:
            return self.system.output(self.system.operating_point(held))
        inputs = np.linspace(held.min(), held.max(), POINTS)
        return np.interp(held, inputs, self.system.output(self.system.operating_point(inputs)))

    def _state(self, held: Array, valid: Mask, nodes: Array, step: float) -> TransientState:
        judged = self._judged(held, valid, nodes)
        return TransientState(v_in=held, lags=(held - judged.v_out,), valid=judged.valid, nodes=nodes, step=step)

    def _out(self, v_in: NDArray[np.float64], lags: tuple[Array, ...]) -> NDArray[np.float64]:
        return np.asarray(v_in - lags[-1])


@dataclass(frozen=True, eq=False, kw_only=True)
class CircuitFollower(TransientFollower):
    """Follower from sizes and bias: the op-amp circuit with all its transistors, of `AmplifierCircuit`.

    Notes
    -----
    The difference to ngspice is that of the integration, some 0.01 % of a step; there is no fit and no simplification
    of the circuit. Junction and overlap capacitances are not modelled.
    """

    circuit: AmplifierCircuit = field(default_factory=AmplifierCircuit.from_design)
    """The op-amp; arrays of op-amps take inputs of a shape to which theirs broadcasts."""
    slew_rate_known: bool = True
    """Whether the circuit slews as the op-amp that it stands for; if not, results are not valid where it might."""

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("circuit", self.circuit, AmplifierCircuit)
        instance("slew_rate_known", self.slew_rate_known, bool)

    @classmethod
    def from_design(
        cls, bias: AmplifierBias = CIRCUIT_B, design: AmplifierDesign = TABLE_II, stages: int = 2
    ) -> CircuitFollower:
        """Return the follower of a bias, of sizes and process, and of a number of stages.

        Parameters
        ----------
        bias : AmplifierBias, default CIRCUIT_B
            Bias, compensation and load.
        design : AmplifierDesign, default TABLE_II
            Sizes and process.
        stages : int, default 2
            2: Miller op-amp (`two_stage`); 1: one stage and an output follower (`one_stage`).

        Returns
        -------
        CircuitFollower
            The follower.

        Raises
        ------
        ValueError
            `stages` is neither 1 nor 2, or an argument is of another type.
        """
        return cls(circuit=AmplifierCircuit.from_design(bias, design, stages))

    @cached_property
    def figures(self) -> CircuitFigures:
        """Gain, unity crossing, phase margin and more with the input at 0 V."""
        return circuit_figures(self.circuit)

    @cached_property
    def system(self) -> System:
        """The circuit."""
        return self.circuit

    @property
    def validity(self) -> Validity:
        """Whether the follower is usable at all, and why not."""
        return self.figures.validity

    @property
    def _crossing(self) -> Array:
        return self.figures.gain_bandwidth

    def _following(self, now: SystemState, held: Array, step: Array) -> tuple[Array, Mask]:
        nodes, following = super()._following(now, held, step)
        crossing = np.max(np.nan_to_num(self.figures.gain_bandwidth), initial=0.0)
        chosen = np.flatnonzero(step * crossing > SHORTEST_HOLD)
        if chosen.size:
            before = np.concatenate([now.v_in[None], held[:-1]])[chosen]
            duration = step[chosen].reshape(-1, *(1,) * now.v_in.ndim)
            nodes[chosen], good = self.circuit.following(held[chosen], (held[chosen] - before) / duration, duration)
            following[chosen] = good.reshape(chosen.size, -1).all(axis=1)
        return nodes, following

    def _findings(self, nodes: Array, held: Array) -> dict[str, Mask]:
        at_rest = self.validity.findings
        found = input_findings(self.circuit, nodes, held, slew_rate_known=self.slew_rate_known)
        for here, anywhere in ((LOW_MARGIN_HERE, LOW_MARGIN), (RINGS_HERE, RINGS)):
            found[here] = found[here] & ~at_rest[anywhere]  # what is so at 0 V is said once
        return found

    @property
    def static_gain(self) -> float:
        """Gain at frequency 0 with the input at 0 V [V/V], of a single circuit."""
        return float(self.figures.closed_loop_gain)

    def _closed_loop_response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        hertz = real_array("frequency", frequency, 0, 1e18).astype(np.float64, copy=False)
        return self.figures.closed_loop_response.at(hertz)


@dataclass(frozen=True, eq=False, kw_only=True)
class SlewingFollower(TransientFollower):
    """Follower from gain, poles, zero and slew rate: two poles that may ring, driven by a square-law pair."""

    open_loop: OpenLoop
    """The op-amp for small signals; numbers or arrays."""
    slew_rate: float | Array
    """Steepest slope of the output [V/s], in [1e-9, 1e18]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("open_loop", self.open_loop, OpenLoop)
        real_array("slew_rate", self.slew_rate, 1e-9, 1e18)

    @cached_property
    def system(self) -> System:
        """The loop; its pair has the overdrive ``slew_rate/(2*pi*A0*p1)``."""
        return PairLoop(self.open_loop, self.slew_rate / (2 * math.pi * self.open_loop.gain_pole_product))

    @cached_property
    def validity(self) -> Validity:
        """Whether the follower is usable at all, and why not."""
        return self.open_loop.validity

    @property
    def _crossing(self) -> Array:
        return self.open_loop.gain_bandwidth

    @property
    def static_gain(self) -> float:
        """Gain at frequency 0 for small signals [V/V], of a single follower."""
        return float(self.open_loop.closed_loop_gain)

    def _closed_loop_response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        return self.open_loop.closed_loop_response(frequency)
