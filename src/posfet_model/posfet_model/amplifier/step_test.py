# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A step as on the bench: overshoot, settling time and slope of a follower from sizes and bias.

A step of 50 mV is not small to an op-amp with little margin: the current of its output stage swings with the ringing,
and the overshoot is up to a quarter less than the linear one of `circuit_figures`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.transient_follower import CircuitFollower

EDGE: Final = 0.015
"""Duration of the step's edge, in periods of the unity crossing."""

SLEWING_STEP: Final = (-0.5, 1.5)
"""Ends of the step on which the slew rates are measured [V]."""

SETTLED: Final = 0.01
"""Deviation from the final value, as a fraction of the step, at which it has settled."""

_SAMPLES: Final = 300
_SLEWING_SAMPLES: Final = 150
_SLEWING_TOLERANCE: Final = 5e-4  # of the step; a slope needs less accuracy than an overshoot
_SLEWING: Final = 1.4  # longest time of slewing, in that of the hand formula
_BAND: Final = 0.2  # of a step, over which a slope is a slew rate
_PER_BAND: Final = 20
_SHARES: Final = np.linspace(0.2, 0.8, 3 * _PER_BAND + 1)
_LONGEST: Final = 40.0  # periods of the unity crossing, beside the time of slewing


@dataclass(frozen=True)
class StepTest:
    """What a step shows; NaN where the follower is unstable or has no operating point."""

    overshoot: float
    """Excursion beyond the final value, as a fraction of the step [1]."""
    settling_time: float
    """Time from the step until the output stays within 1 % of it [s], to 1 % of the window; inf where unstable."""
    slope: float
    """Mean slope of the output from 20 to 80 % of the step [V/s]: the slew rate, if the step is large enough."""


def step_test(follower: CircuitFollower, volts: float = 0.05, start: float = 0.0) -> StepTest:
    """Return what a step of the input shows, by integration.

    Parameters
    ----------
    follower : CircuitFollower
        A single follower.
    volts : float, default 0.05
        Height of the step [V], positive or negative, within +-20.
    start : float, default 0.0
        Input before the step [V], within +-20.

    Returns
    -------
    StepTest
        Overshoot, settling time and slope.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the follower is an array.
    """
    follower = instance("follower", follower, CircuitFollower)
    volts, start = real_number("volts", volts, -20, 20), real_number("start", start, -20, 20)
    if follower.circuit.shape or volts == 0:
        raise ValueError("follower must be a single one, and volts must not be 0")
    figures = follower.figures
    period = 1 / float(figures.gain_bandwidth)
    slew_rate = float(np.minimum(figures.slew_rate, figures.falling_slew_rate))
    if not (figures.stable and np.isfinite(period) and slew_rate > 0):
        return StepTest(np.nan, np.inf, np.nan)
    slewing = abs(volts) / slew_rate
    end = EDGE * period + 2 * slewing + min(3 * float(figures.settling_time), _LONGEST * period)
    time = np.r_[0.0, EDGE * period + (end - EDGE * period) * np.linspace(0, 1, _SAMPLES) ** 2]  # denser at first
    out = follower.run(time, start + volts * np.minimum(time / (EDGE * period), 1.0)).v_out
    final = float(follower.run([0.0], [start + volts]).v_out[0])
    rise = (out - out[0]) / (final - out[0])
    outside = np.flatnonzero(np.abs(rise - 1) > SETTLED)
    return StepTest(
        overshoot=max(float(rise.max()) - 1, 0.0),
        settling_time=float(time[min(outside[-1] + 1, _SAMPLES)]) if outside[-1] < _SAMPLES else np.inf,
        slope=mean_slope(time, out, final),
    )


def slew_rates(
    follower: CircuitFollower, low: float = SLEWING_STEP[0], high: float = SLEWING_STEP[1]
) -> tuple[float, float]:
    """Return the slew rates of a large step up and of the same step down, by integration.

    The steepest mean slope over a fifth of the step, between 20 and 80 % of it: neither what capacitances pass on at
    the input's edge, nor the end, where the input pair conducts on both sides again.

    Parameters
    ----------
    follower : CircuitFollower
        A single follower.
    low, high : float
        Ends of the step [V], within +-20; -0.5 and 1.5 V by default.

    Returns
    -------
    tuple of float
        Rise and fall [V/s], positive; NaN where the follower is unstable or has no operating point.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the follower is an array.
    """
    follower = instance("follower", follower, CircuitFollower)
    low = real_number("low", low, -20, 20)
    high = real_number("high", high, -20, 20)
    if follower.circuit.shape or not low < high:
        raise ValueError("follower must be a single one, and low must be below high")
    figures = follower.figures
    period = 1 / float(figures.gain_bandwidth)
    slew_rate = float(np.minimum(figures.slew_rate, figures.falling_slew_rate))
    if not (figures.stable and np.isfinite(period) and slew_rate > 0):
        return np.nan, np.nan
    edge, window = EDGE * period, _SLEWING * (high - low) / slew_rate + period
    time = np.r_[0.0, edge + window * np.linspace(0, 1, _SLEWING_SAMPLES) ** 2]  # for a rise far faster than the fall
    up = low + (high - low) * np.minimum(time / edge, 1.0)
    coarse = replace(follower, tolerance=max(follower.tolerance, _SLEWING_TOLERANCE * (high - low)))
    out = coarse.run(time, np.stack([up, low + high - up], axis=-1)).v_out
    if not np.isfinite(out).all():
        return np.nan, np.nan
    return steepest_slope(time, out[:, 0], float(out[0, 1])), steepest_slope(time, out[:, 1], float(out[0, 0]))


def steepest_slope(time: Array, v_out: Array, final: float) -> float:
    """Return the steepest mean slope over a fifth of a step, between 20 and 80 % of it; unchecked.

    Parameters
    ----------
    time : ndarray
        Instants [s], increasing.
    v_out : ndarray
        Output of a large step [V], at rest first.
    final : float
        Final value [V].

    Returns
    -------
    float
        Slope [V/s], positive for either direction; NaN where the step does not reach 80 %.
    """
    rise = (v_out - v_out[0]) / (final - v_out[0])
    instants = np.array([reached(time, rise, share) for share in _SHARES])
    return float(_BAND * abs(final - v_out[0]) / (instants[_PER_BAND:] - instants[:-_PER_BAND]).min())


def reached(time: Array, rise: Array, share: float) -> float:
    """Return when the output first reaches a share of a step, between samples by interpolation; unchecked.

    Parameters
    ----------
    time : ndarray
        Instants [s], increasing.
    rise : ndarray
        Output as a share of the step, 0 at first [1].
    share : float
        The share [1].

    Returns
    -------
    float
        Instant [s]; NaN where it does not.
    """
    beyond = np.flatnonzero(rise >= share)
    if not beyond.size:
        return float("nan")
    ends = slice(beyond[0] - 1, beyond[0] + 1)
    return float(np.interp(share, rise[ends], time[ends]))


def mean_slope(time: Array, v_out: Array, final: float) -> float:
    """Return the mean slope of a step from 20 to 80 % of it, where it first reaches them; unchecked.

    Parameters
    ----------
    time : ndarray
        Instants [s], increasing.
    v_out : ndarray
        Output of a large step [V], at rest first.
    final : float
        Final value [V].

    Returns
    -------
    float
        Slope [V/s], positive for either direction; NaN where the step does not reach 80 %.
    """
    rise = (v_out - v_out[0]) / (final - v_out[0])
    return abs(0.6 * (final - float(v_out[0]))) / (reached(time, rise, 0.8) - reached(time, rise, 0.2))
