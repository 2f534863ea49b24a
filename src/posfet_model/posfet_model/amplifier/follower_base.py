# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Base class of the follower models: limits, state, time series, frequency response. The models: `follower`."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.types import Array, FloatArray
from posfet_model._lib.validation import instance, real_array
from posfet_model.amplifier.closed_loop import FollowerLimits

VOLTAGE_LIMIT: Final = 1e6
"""Largest accepted magnitude of a voltage [V]."""

STEP_LIMIT: Final = 1e9
"""Longest accepted step [s]; a step of 0 is a jump of the input."""

TIME_LIMIT: Final = 1e12
"""Largest accepted magnitude of a time stamp [s]; Unix time is 1.7e9 s."""


_FLOAT64: Final = np.dtype(np.float64)
_FRAME: Final = 8192  # elements


@dataclass(frozen=True, eq=False)
class FollowerState:
    """State of a follower between steps."""

    v_in: NDArray[np.float64]
    """Input voltage at the end of the last step, clipped to the limits, offset included [V], any shape."""
    lags: tuple[NDArray[Any], ...]
    """Lag of each internal node behind v_in [V], in v_in's shape; complex where the poles are; the real part of the
    last one is the lag of the output."""
    valid: NDArray[np.bool_]
    """False where the model is not valid, in v_in's shape."""


@dataclass(frozen=True, eq=False)
class FollowerOutput:
    """Output of a follower, all fields in the input's shape."""

    v_out: NDArray[np.float64]
    """Output voltage [V]."""
    valid: NDArray[np.bool_]
    """False where the input or the required slope exceeds the limits, or a finding applies: v_out is unreliable."""
    findings: Mapping[str, NDArray[np.bool_]] | None = None
    """Where reasons against it apply, by reason; None from the models that state none."""

    @property
    def reasons(self) -> list[str]:
        """Reasons that apply anywhere."""
        return [reason for reason, mask in (self.findings or {}).items() if mask.any()]


@dataclass(frozen=True, eq=False)
class FollowerSeries:
    """Result of a series of steps: output and final state."""

    output: FollowerOutput
    """Output after each step, shape [t] or [t, n]."""
    end: FollowerState
    """State after the last step, from which another series continues."""


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Small-signal response of a follower, all fields in the frequency's shape."""

    gain: NDArray[np.float64]
    """Magnitude [V/V]."""
    phase: NDArray[np.float64]
    """Phase [rad], in (-pi, 0]."""
    valid: NDArray[np.bool_]
    """False above the frequency limit of the model."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Follower(ABC):
    """Base class of the follower models. Accepts float32 input; state and output are float64."""

    offset: float | FloatArray = 0.0
    """Input offset [V], a number or one per taxel, within +-1e6."""
    limits: FollowerLimits = field(default_factory=FollowerLimits)
    """Range in which the model is valid."""
    usable: bool = True
    """Whether the model is applicable at all; if not, no result is valid."""

    def __post_init__(self) -> None:
        real_array("offset", self.offset, -VOLTAGE_LIMIT, VOLTAGE_LIMIT)
        instance("limits", self.limits, FollowerLimits)
        instance("usable", self.usable, bool)

    @property
    @abstractmethod
    def static_gain(self) -> float:
        """Gain at frequency 0 [V/V]."""

    def _start_lags(self, v_in: NDArray[np.float64]) -> tuple[NDArray[Any], ...]:
        """Return the lags at rest, zeros of v_in's shape; none where the model has no memory."""
        del v_in
        return ()

    def _advance_lags(
        self, lags: tuple[NDArray[Any], ...], change: NDArray[np.float64], step: NDArray[np.float64]
    ) -> tuple[NDArray[Any], ...]:
        """Return the lags after `step` [s] in which the input changed linearly by `change` [V]."""
        del change, step
        return lags

    def _series_lags(
        self, start: tuple[NDArray[Any], ...], change: NDArray[np.float64], step: NDArray[np.float64]
    ) -> tuple[NDArray[Any], ...]:
        """Return the lags after each of many steps; change is [t] or [t, n], step broadcasts to it, t >= 1."""
        del change, step
        return start

    def _transfer(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the transfer function in units of the static gain at s = j*2*pi*f [1/s]."""
        return np.ones_like(s)

    def _slope(
        self, lags: tuple[NDArray[Any], ...], change: NDArray[np.float64], step: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the slope [V/s] of the output at the end of a step, to be compared with the slew rate."""
        del lags
        slope = change / np.where(step > 0, step, 1.0)
        return self.static_gain * np.where(step > 0, slope, np.where(change == 0, 0.0, np.copysign(np.inf, change)))

    def start(self, v_in: ArrayLike) -> FollowerState:
        """Return the state at rest (zero lag) at an input voltage.

        Parameters
        ----------
        v_in : array_like
            Input voltage [V], any shape, within +-1e6.

        Returns
        -------
        FollowerState
            The state, of the shape of `v_in`.

        Raises
        ------
        ValueError
            The voltage is not real, not finite or out of range.
        """
        held, valid = self._hold(v_in)
        return FollowerState(v_in=held, lags=self._start_lags(held), valid=valid)

    def advance(self, state: FollowerState, v_in: ArrayLike, step: ArrayLike) -> FollowerState:
        """Return the state after one step in which the input changed linearly.

        Parameters
        ----------
        state : FollowerState
            State at the start of the step.
        v_in : array_like
            Input voltage at the end of the step [V], of the state's shape.
        step : array_like
            Length of the step [s], in [0, 1e9], a number or of the state's shape.

        Returns
        -------
        FollowerState
            State at the end of the step.

        Raises
        ------
        ValueError
            An argument is not real, not finite, out of range or of another shape.
        """
        instance("state", state, FollowerState)
        held, valid = self._hold(v_in)
        checked = isinstance(step, float) and 0 <= step <= STEP_LIMIT  # saves the hot path the general check
        duration = np.asarray(step if checked else real_array("step", step, 0, STEP_LIMIT), np.float64)
        if held.shape != state.v_in.shape or duration.shape not in ((), held.shape):
            raise ValueError(
                f"v_in and step must have the state's shape {state.v_in.shape}, got {held.shape} and {duration.shape}"
            )
        change = held - state.v_in
        lags = self._advance_lags(state.lags, change, duration)
        if self.limits.any_slew:
            valid &= self.limits.allow_slope(self._slope(lags, change, duration))
        return FollowerState(v_in=held, lags=lags, valid=valid)

    def output(self, state: FollowerState) -> FollowerOutput:
        """Return the output voltage [V] of a state, and whether it is valid."""
        instance("state", state, FollowerState)
        return FollowerOutput(v_out=self._out(state.v_in, state.lags), valid=state.valid)

    def advance_series(self, state: FollowerState, v_in: ArrayLike, step: ArrayLike) -> FollowerSeries:
        """Return the outputs of many consecutive steps: a vectorised `advance`, for long series processed in pieces.

        Parameters
        ----------
        state : FollowerState
            State at the start of the first step, of shape () or [n].
        v_in : array_like
            Input voltage at the end of each step [V], shape [t], or [t, n] for a state of shape [n], t >= 1.
        step : array_like
            Length of the steps [s], in [0, 1e9], a number or of shape [t].

        Returns
        -------
        FollowerSeries
            Output after each step, and the final state.

        Raises
        ------
        ValueError
            An argument is not real, not finite, out of range or of another shape.
        """
        instance("state", state, FollowerState)
        held, valid = self._hold(v_in)
        duration = np.asarray(real_array("step", step, 0, STEP_LIMIT), np.float64)
        if held.ndim not in (1, 2) or not len(held) or held.shape[1:] != state.v_in.shape:
            raise ValueError(f"v_in must be [t] before the state's shape {state.v_in.shape}, got {held.shape}")
        if duration.shape not in ((), held.shape[:1]):
            raise ValueError(f"step must be a number or of shape {held.shape[:1]}, got {duration.shape}")
        return self._follow(state, held, valid, np.broadcast_to(duration, held.shape[:1]))

    def run(self, time: ArrayLike, v_in: ArrayLike) -> FollowerOutput:
        """Return the output over a whole time series, starting from rest at the first sample.

        Parameters
        ----------
        time : array_like
            [s], shape [t], t >= 1, never decreasing, within +-1e12; steps may be uneven, up to 1e9, and a step of 0 is
            a jump of the input. Only differences count. Unix time in float64 resolves 0.24 us: subtract the first time
            before converting to float64.
        v_in : array_like
            Input voltage [V], shape [t], or [t, n] for n taxels, within +-1e6.

        Returns
        -------
        FollowerOutput
            Output, of the shape of `v_in`.

        Raises
        ------
        ValueError
            An argument is not real, not finite, out of range or of another shape, or time decreases.
        """
        instants = real_array("time", time, -TIME_LIMIT, TIME_LIMIT).astype(np.float64, copy=False)
        held, valid = self._hold(v_in)
        if instants.ndim != 1 or not instants.size or held.ndim not in (1, 2) or len(held) != len(instants):
            raise ValueError(f"time must be [t] and v_in [t] or [t, n], got {instants.shape} and {held.shape}")
        step = np.diff(instants)
        if step.size and step.min() < 0:
            raise ValueError(f"time must not decrease, got a step of {step.min():g} s at sample {step.argmin() + 1}")
        if step.size and step.max() > STEP_LIMIT:
            raise ValueError(f"steps of time must be in [0, {STEP_LIMIT:g}] s, got {step.max():g}")
        return self._run(held, valid, step)

    def _run(self, held: NDArray[np.float64], valid: NDArray[np.bool_], step: NDArray[np.float64]) -> FollowerOutput:
        """Return the output for the limited inputs `held`, [t] or [t, n], from rest at the first, in steps [t - 1]."""
        start = FollowerState(v_in=held[0], lags=self._start_lags(held[0]), valid=np.asarray(valid[0]))
        first = self._out(held[:1], tuple(lag[None] for lag in start.lags))
        if not step.size:
            return FollowerOutput(v_out=first, valid=valid)
        later = self._follow(start, held[1:], valid[1:], step).output
        return FollowerOutput(np.concatenate([first, later.v_out]), np.concatenate([valid[:1], later.valid]))

    def _follow(
        self,
        state: FollowerState,
        held: NDArray[np.float64],
        valid: NDArray[np.bool_],
        step: NDArray[np.float64],
    ) -> FollowerSeries:
        """Return the series for the limited inputs `held`, [t] or [t, n], in steps [t]; `valid` is their validity."""
        step = step.reshape(-1, *(1,) * (held.ndim - 1))
        change = np.empty_like(held)
        np.subtract(held[0], state.v_in, out=change[0, ...])
        np.subtract(held[1:], held[:-1], out=change[1:])
        lags = self._series_lags(state.lags, change, step)
        if self.limits.any_slew:
            valid = valid & self.limits.allow_slope(self._slope(lags, change, step))
        end = FollowerState(v_in=held[-1], lags=tuple(lag[-1] for lag in lags), valid=np.asarray(valid[-1]))
        return FollowerSeries(output=FollowerOutput(v_out=self._out(held, lags), valid=valid), end=end)

    def response(self, frequency: ArrayLike) -> FrequencyResponse:
        """Return the small-signal gain and phase.

        Parameters
        ----------
        frequency : array_like
            f [Hz], any shape, in [0, 1e18].

        Returns
        -------
        FrequencyResponse
            Gain [V/V] and phase [rad], of the shape of `frequency`.

        Raises
        ------
        ValueError
            A frequency is not real, not finite or out of range.
        """
        hertz = real_array("frequency", frequency, 0, 1e18).astype(np.float64, copy=False)
        transfer = self.static_gain * self._transfer(np.asarray(2j * math.pi * hertz, np.complex128))
        return FrequencyResponse(
            gain=np.abs(transfer), phase=np.angle(transfer), valid=np.asarray(hertz <= self.limits.frequency)
        )

    def _hold(self, v_in: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the input with its offset, clipped to the limits, and where it is within them."""
        if _within_limit(v_in):  # saves the hot path the general check
            voltage = v_in
        else:
            voltage = real_array("v_in", v_in, -VOLTAGE_LIMIT, VOLTAGE_LIMIT).astype(np.float64, copy=False)
        wanted = voltage.copy() if type(self.offset) is float and self.offset == 0 else self._with_offset(voltage)
        if self.limits.v_low == -math.inf and self.limits.v_high == math.inf:
            valid = np.empty(wanted.shape, np.bool_)
            valid.fill(self.usable)  # a third of the time of np.ones
            return wanted, valid
        held = np.clip(wanted, self.limits.v_low, self.limits.v_high)
        return held, np.asarray((held == wanted) & self.usable)

    def _with_offset(self, voltage: NDArray[np.float64]) -> NDArray[np.float64]:
        try:
            wanted = np.asarray(voltage + self.offset)
        except ValueError:
            wanted = np.empty(0)
        if wanted.shape != voltage.shape:
            raise ValueError(f"offset {np.shape(self.offset)} must broadcast to v_in {voltage.shape}")
        return wanted

    def _out(self, v_in: NDArray[np.float64], lags: tuple[NDArray[Any], ...]) -> NDArray[np.float64]:
        out = np.asarray(v_in - lags[-1].real if lags else v_in.copy())
        out *= np.asarray(self.static_gain)  # twice as fast as with a float
        return out


def check_shape(own: tuple[int, ...], v_in: Array) -> None:
    """Raise ValueError unless a follower whose fields are of the shape `own` takes inputs of this shape; unchecked.

    Parameters
    ----------
    own : tuple of int
        Shape of the follower's fields.
    v_in : ndarray
        Input voltage.
    """
    fitting = all(wide in (1, given) for wide, given in zip(own[::-1], v_in.shape[::-1], strict=False))
    if not fitting or len(own) > v_in.ndim:
        raise ValueError(f"v_in must be of a shape to which {own} broadcasts, got {v_in.shape}")


def _within_limit(voltage: object) -> TypeGuard[NDArray[np.float64]]:
    """Return whether `voltage` is an array of float64 clearly within the limit; a NaN is not.

    For a frame the sum of squares is the fastest check: no element is larger than its root. For a long series the
    extremes are faster; NumPy would share its sum of squares out to threads, which costs more.
    """
    if type(voltage) is not np.ndarray or voltage.dtype is not _FLOAT64:  # not of a masked array
        return False
    if voltage.size <= _FRAME:
        return bool(np.vdot(voltage, voltage) <= VOLTAGE_LIMIT * VOLTAGE_LIMIT)
    return bool(voltage.min() >= -VOLTAGE_LIMIT and voltage.max() <= VOLTAGE_LIMIT)
