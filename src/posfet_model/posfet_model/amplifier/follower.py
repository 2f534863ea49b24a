# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Behavioural models of the unity-gain voltage follower behind each POSFET, exact in time for any step.

Five models, from the simplest: `IdealFollower`, `StaticFollower` (finite gain), `OnePoleFollower`, `TwoPoleFollower`,
`SquareLawFollower` (one pole and the slew rate of a square-law differential pair). Each has the output
``v_out = gain*(v_in + offset - lag)``; they differ in the lag.

The input is piecewise linear between samples (first-order hold). For such an input a step of any length is the exact
solution of the model's equation: no step is unstable, and splitting a step changes nothing but rounding. The state
variable is the lag, not the output: it decays to zero at rest, so rounding errors do not accumulate.

`FollowerLimits` states the range in which a model is valid. Beyond it, results are flagged in `valid`, and the input is
clipped to the limit instead of being extrapolated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.first_order import linear_recurrence, mean_decay
from posfet_model._lib.types import Array
from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.closed_loop import FREQUENCY_RANGE, ClosedLoop, FollowerLimits, close_loop
from posfet_model.amplifier.differential_pair import NO_LEAD, Lead, pair_current
from posfet_model.amplifier.follower_base import (
    VOLTAGE_LIMIT,
    Follower,
    FollowerOutput,
    FollowerState,
    FrequencyResponse,
)
from posfet_model.amplifier.pair_settling import settle, settle_series
from posfet_model.amplifier.two_pole_chain import TwoPoleChain

__all__ = [
    "VOLTAGE_LIMIT",
    "ClosedLoop",
    "Follower",
    "FollowerLimits",
    "FollowerOutput",
    "FollowerState",
    "FrequencyResponse",
    "IdealFollower",
    "OnePoleFollower",
    "SquareLawFollower",
    "StaticFollower",
    "TwoPoleFollower",
    "close_loop",
]

GAIN_RANGE: Final = (1e-3, 1e3)
"""Accepted static gains."""


Lags = tuple[NDArray[Any], ...]


class IdealFollower(Follower):
    """Output equals input: ``v_out = v_in + offset``."""

    @property
    def static_gain(self) -> float:
        """Gain at frequency 0 [V/V]."""
        return 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class StaticFollower(Follower):
    """Finite gain, no memory: ``v_out = gain*(v_in + offset)``."""

    gain: float
    """Static gain [V/V], in [1e-3, 1e3]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        real_number("gain", self.gain, *GAIN_RANGE)

    @property
    def static_gain(self) -> float:
        """Gain at frequency 0 [V/V]."""
        return self.gain


@lru_cache(maxsize=256)
def _one_pole_step(time_constant: float, step: float) -> tuple[Array, Array]:
    """Return decay and input weight of one step; cached, because a simulation repeats few different steps.

    As arrays, which NumPy multiplies in half the time of floats.
    """
    ratio = np.asarray(step / time_constant)
    return np.asarray(np.exp(-ratio)), mean_decay(ratio)


@dataclass(frozen=True, eq=False, kw_only=True)
class OnePoleFollower(StaticFollower):
    """One pole: ``tau*d(v_out)/dt = gain*(v_in + offset) - v_out`` with ``tau = 1/(2*pi*bandwidth)``.

    Over a step h the lag l becomes ``l*exp(-h/tau) + (u1 - u0)*(1 - exp(-h/tau))/(h/tau)``.
    """

    bandwidth: float
    """-3 dB frequency of the follower [Hz], in [1e-12, 1e15]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        real_number("bandwidth", self.bandwidth, *FREQUENCY_RANGE)

    @property
    def time_constant(self) -> float:
        """Small-signal time constant [s]."""
        return 1 / (2 * math.pi * self.bandwidth)

    def _start_lags(self, v_in: Array) -> Lags:
        return (np.zeros_like(v_in),)

    def _advance_lags(self, lags: Lags, change: Array, step: Array) -> Lags:
        decay, weight = _one_pole_step(self.time_constant, float(step)) if step.ndim == 0 else self._weights(step)
        lag = np.asarray(lags[0] * decay)
        lag += change * weight
        return (lag,)

    def _series_lags(self, start: Lags, change: Array, step: Array) -> Lags:
        decay, weight = self._weights(step)
        return (linear_recurrence(decay, change * weight, start[0]),)

    def _weights(self, step: Array) -> tuple[Array, Array]:
        ratio = step / self.time_constant
        return np.exp(-ratio), mean_decay(ratio)

    def _slope(self, lags: Lags, change: Array, step: Array) -> Array:
        return np.asarray(self.gain * lags[0] / self.time_constant)

    def _transfer(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(1 / (1 + s * self.time_constant))


@dataclass(frozen=True, eq=False, kw_only=True)
class TwoPoleFollower(StaticFollower):
    """Two poles: ``H(s) = gain/(1 + s/(quality*w0) + (s/w0)^2)`` with ``w0 = 2*pi*natural_frequency``.

    A quality of 1/2 is critical damping; above it the step response overshoots. A dominant pole and a second pole at m
    times the gain-bandwidth product give a quality of about 1/sqrt(m).
    """

    natural_frequency: float
    """w0/(2*pi) [Hz], in [1e-12, 1e15]."""
    quality: float
    """Q [1], in [0.05, 50]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        real_number("natural_frequency", self.natural_frequency, *FREQUENCY_RANGE)
        real_number("quality", self.quality, 0.05, 50)

    @classmethod
    def from_bandwidth(
        cls,
        gain: float,
        bandwidth: float,
        quality: float,
        *,
        offset: float = 0.0,
        limits: FollowerLimits | None = None,
    ) -> TwoPoleFollower:
        """Return the follower with a given -3 dB frequency.

        With y = (bandwidth/natural_frequency)^2 and c = 1 - 1/(2*Q^2): ``(1 - y)^2 + y/Q^2 = 2``, so ``y = c + sqrt(c^2
        + 1)``.

        Parameters
        ----------
        gain : float
            Static gain [V/V], in [1e-3, 1e3].
        bandwidth : float
            -3 dB frequency [Hz], in [1e-9, 1e12].
        quality : float
            Q [1], in [0.05, 50].
        offset : float, default 0.0
            Input offset [V], within +-1e6.
        limits : FollowerLimits, optional
            Range of validity; none by default.

        Returns
        -------
        TwoPoleFollower
            The follower.

        Raises
        ------
        ValueError
            An argument is not real, not finite or out of range.
        """
        bandwidth = real_number("bandwidth", bandwidth, 1e-9, 1e12)
        c = 1 - 0.5 / real_number("quality", quality, 0.05, 50) ** 2
        root = math.hypot(c, 1)
        y = c + root if c > 0 else 1 / (root - c)
        return cls(
            gain=gain,
            natural_frequency=bandwidth / math.sqrt(y),
            quality=quality,
            offset=offset,
            limits=FollowerLimits() if limits is None else limits,
        )

    def _poles(self) -> tuple[complex, complex]:
        """Return both poles times -1 [1/s], the slower one first; complex conjugate where quality > 1/2."""
        w0 = 2 * math.pi * self.natural_frequency
        middle = 0.5 / self.quality
        if middle >= 1:
            fast = middle + math.sqrt((middle - 1) * (middle + 1))
            return w0 / fast, w0 * fast
        turn = 1j * math.sqrt((1 - middle) * (1 + middle))
        return w0 * (middle - turn), w0 * (middle + turn)

    @cached_property
    def _chain(self) -> TwoPoleChain:
        slow, fast = self._poles()
        return TwoPoleChain(np.asarray(1 / slow), np.asarray(1 / fast), np.zeros(()))

    def _start_lags(self, v_in: Array) -> Lags:
        return self._chain.start(v_in.shape)

    def _advance_lags(self, lags: Lags, change: Array, step: Array) -> Lags:
        return self._chain.advance((lags[0], lags[1]), change, step)

    def _series_lags(self, start: Lags, change: Array, step: Array) -> Lags:
        return self._chain.series((start[0], start[1]), change, step)

    def _slope(self, lags: Lags, change: Array, step: Array) -> Array:
        return np.asarray(self.gain * self._chain.slope((lags[0], lags[1]), change, step))

    def _transfer(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        x = s / (2 * math.pi * self.natural_frequency)
        return np.asarray(1 / (1 + x / self.quality + x * x))


@dataclass(frozen=True, eq=False, kw_only=True)
class SquareLawFollower(OnePoleFollower):
    """One pole driven by a square-law differential pair, whose current limits the slew rate.

    The pair charges a capacitor, ``tau*dw/dt = gain*Vov*f(x)`` with ``x = (v_in + offset - v_out/gain)/Vov``,
    ``tau = 1/(2*pi*bandwidth)`` and f, the current of the pair as a function of its overdrive in units of the tail
    current, which saturates at 1 (`differential_pair.pair_current`). The output is w without a lead, and ``w +
    gain*Vov*(linear*f + square*f**2)`` with one (`differential_pair.Lead`). The slew rate is ``gain*Vov/tau``.

    Notes
    -----
    The finite gain is referred to the pair's input. In a circuit, part of the tail current is lost in an output
    resistance instead; the two agree for small signals, and to v_out/(A0*Vov) of the slew rate in saturation. With a
    lead the -3 dB frequency is not `bandwidth` but ``bandwidth/sqrt(1 + 2*linear - linear**2)``.
    """

    overdrive: float
    """Vov [V], the overdrive of the pair at balance: sqrt(tail current/gain factor), in [1e-6, 1e3]."""
    lead: Lead = NO_LEAD
    """Direct contribution of the pair's current to the output."""

    def __post_init__(self) -> None:
        super().__post_init__()
        real_number("overdrive", self.overdrive, 1e-6, 1e3)
        instance("lead", self.lead, Lead)

    @property
    def slew_rate(self) -> float:
        """Steepest slope of the output in saturation [V/s]; a jump of the input also makes the lead jump."""
        return self.gain * self.overdrive / self.time_constant

    def _advance_lags(self, lags: Lags, change: Array, step: Array) -> Lags:
        x = lags[0] / self.overdrive
        return (self.overdrive * settle(x, change / self.overdrive, step / self.time_constant, self.lead),)

    def _series_lags(self, start: Lags, change: Array, step: Array) -> Lags:
        ratio = np.broadcast_to(step / self.time_constant, change.shape)
        return (self.overdrive * settle_series(start[0] / self.overdrive, change / self.overdrive, ratio, self.lead),)

    def _slope(self, lags: Lags, change: Array, step: Array) -> Array:
        return np.asarray(self.slew_rate * pair_current(lags[0] / self.overdrive))

    def _transfer(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        x = s * self.time_constant
        return np.asarray((1 + self.lead.linear * x) / (1 + (1 + self.lead.linear) * x))
