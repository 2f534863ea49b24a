# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Linear follower of an op-amp of two poles and a zero, exact in time for any step: it rings, and says so."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import instance
from posfet_model.amplifier.follower_base import (
    Follower,
    FollowerOutput,
    FollowerSeries,
    FollowerState,
    FrequencyResponse,
    check_shape,
)
from posfet_model.amplifier.input_findings import LINEAR_INPUT, SLEW_RATE_NOT_GIVEN
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.two_pole_chain import TwoPoleChain
from posfet_model.amplifier.validity import Validity

BEYOND_LIMITS: Final = "the input is beyond the limits of the model"
SLEWS: Final = "the output would have to be steeper than the slew rate"


@dataclass(frozen=True, eq=False, kw_only=True)
class RingingFollower(Follower):
    """Follower ``H = A/(1 + A)`` of an op-amp A of two poles and a zero (`OpenLoop`), for small signals.

    Notes
    -----
    A step of any length is the exact solution for an input that is linear in it; real, equal and complex poles are the
    same to it. Where an unstable follower's output would grow beyond 1e6 V, it stays there, never valid. The op-amp's
    fields may be arrays, for inputs of a shape to which theirs broadcasts. Without a slew rate in `limits`, results are
    not valid where the input pair sees more than `input_findings.LINEAR_INPUT`.
    """

    open_loop: OpenLoop
    """The op-amp."""

    def __post_init__(self) -> None:
        super().__post_init__()
        instance("open_loop", self.open_loop, OpenLoop)

    @cached_property
    def validity(self) -> Validity:
        """Whether the op-amp is usable as a follower, and why not."""
        return self.open_loop.validity

    @property
    def static_gain(self) -> float:
        """Gain at frequency 0 [V/V], of a single follower."""
        return float(self.open_loop.closed_loop_gain)

    @cached_property
    def _chain(self) -> TwoPoleChain:
        step = self.open_loop.step_response
        return TwoPoleChain(*step.time_constants, step.zero_time)

    @cached_property
    def _usable(self) -> Mask:
        return self.validity.valid

    def _start_lags(self, v_in: Array) -> tuple[NDArray[Any], ...]:
        return self._chain.start(v_in.shape)

    def _advance_lags(self, lags: tuple[NDArray[Any], ...], change: Array, step: Array) -> tuple[NDArray[Any], ...]:
        return self._chain.advance((lags[0], lags[1]), change, step)

    def _series_lags(self, start: tuple[NDArray[Any], ...], change: Array, step: Array) -> tuple[NDArray[Any], ...]:
        return self._chain.series((start[0], start[1]), change, step)

    def _slope(self, lags: tuple[NDArray[Any], ...], change: Array, step: Array) -> Array:
        return np.asarray(self.open_loop.closed_loop_gain * self._chain.slope((lags[0], lags[1]), change, step))

    def _out(self, v_in: Array, lags: tuple[NDArray[Any], ...]) -> Array:
        return np.asarray(self.open_loop.closed_loop_gain * (v_in - self._chain.lag((lags[0], lags[1]))))

    def _hold(self, v_in: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        held, valid = super()._hold(v_in)
        check_shape(self._usable.shape, held)
        return held, valid & self._usable

    def _run(self, held: Array, valid: Mask, step: Array) -> FollowerOutput:
        check_shape(self._usable.shape, held[0])
        return self._explained(super()._run(held, valid, step), held, valid)

    def _follow(self, state: FollowerState, held: Array, valid: Mask, step: Array) -> FollowerSeries:
        series = super()._follow(state, held, valid, step)
        return replace(series, output=self._explained(series.output, held, valid))

    def _steep(self, v_in: Array, v_out: Array) -> Mask:
        """Return where the output may have to be steeper than a slew rate that was not given."""
        if math.isfinite(self.limits.slew_rate):
            return np.zeros((), np.bool_)
        return np.asarray(np.abs(v_in - v_out / self.open_loop.closed_loop_gain) > LINEAR_INPUT)

    def advance(self, state: FollowerState, v_in: ArrayLike, step: ArrayLike) -> FollowerState:
        """Return the state after one step, as of every follower; not valid where it may slew at a rate not given."""
        after = super().advance(state, v_in, step)
        return replace(after, valid=after.valid & ~self._steep(after.v_in, self._out(after.v_in, after.lags)))

    def _explained(self, output: FollowerOutput, held: Array, held_valid: Mask) -> FollowerOutput:
        """Return the output with the reasons against it; `held_valid` is False beyond the limits of the input, too."""
        steep = self._steep(held, output.v_out)
        findings = {
            **self.validity.findings,
            BEYOND_LIMITS: ~held_valid & self._usable,
            SLEWS: held_valid & ~output.valid & ~steep,
            SLEW_RATE_NOT_GIVEN: held_valid & steep,
        }
        output = replace(output, valid=output.valid & ~steep)
        shown = {reason: np.broadcast_to(mask, output.valid.shape) for reason, mask in findings.items() if mask.any()}
        return replace(output, findings=shown)

    def response(self, frequency: ArrayLike) -> FrequencyResponse:
        """Return the gain and phase.

        Parameters
        ----------
        frequency : array_like
            f [Hz], any shape, in [0, 1e18]; broadcasts with the op-amp.

        Returns
        -------
        FrequencyResponse
            Gain [V/V] and phase [rad].

        Raises
        ------
        ValueError
            A frequency is not real, not finite or out of range.
        """
        transfer = self.open_loop.closed_loop_response(frequency)
        within = np.asarray(frequency) <= self.limits.frequency
        return FrequencyResponse(gain=np.abs(transfer), phase=np.angle(transfer), valid=within & self._usable)
