# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Integration schemes for a one-pole follower, stable and unstable, to show the error of each for a given step.

The model uses only the exact exponential. The others are here for the error map in docs/stability.md.

The test: an input that jumps from 0 to 1 V and stays there. With the time constant tau and the step h, the result
depends on ``z = h/tau`` alone. Each scheme integrates the lag l of the output, ``dl/dt = -l/tau`` with l = 1 V at the
start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array

STEPS: Final = 200
"""Steps of the test."""

SLEW_LIMIT: Final = 0.39
"""Slew rate of the clipped scheme [V per time constant]: 0.39 V of overdrive."""

DIVERGED: Final = 1e6
"""Error [V] above which a scheme counts as diverged."""


@dataclass(frozen=True)
class Scheme:
    """An integration scheme."""

    name: str
    advance: Callable[[Array, Array], Array]
    """Lag one step later [V], from the lag [V] and z."""
    exact: Callable[[Array], Array]
    """Exact lag [V] at a time in units of tau."""


def _decay(time: Array) -> Array:
    return np.exp(-time)


def _clipped_decay(time: Array) -> Array:
    """Return the exact lag with a limited slew rate: linear down to the limit, then exponential."""
    slewing = (1 - SLEW_LIMIT) / SLEW_LIMIT
    return np.where(time < slewing, 1 - SLEW_LIMIT * time, SLEW_LIMIT * np.exp(-np.maximum(time - slewing, 0)))


SCHEMES: Final = (
    Scheme("Euler", lambda lag, z: lag * (1 - z), _decay),
    Scheme("Heun", lambda lag, z: lag * (1 - z + z**2 / 2), _decay),
    Scheme("Runge-Kutta 4", lambda lag, z: lag * (1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24), _decay),
    Scheme("Euler, slew clipped", lambda lag, z: lag - z * np.clip(lag, -SLEW_LIMIT, SLEW_LIMIT), _clipped_decay),
    Scheme("trapezoidal", lambda lag, z: lag * (1 - z / 2) / (1 + z / 2), _decay),
    Scheme("backward Euler", lambda lag, z: lag / (1 + z), _decay),
    Scheme("exact exponential", lambda lag, z: lag * np.exp(-z), _decay),
)


def largest_error(scheme: Scheme, z: Array, steps: int = STEPS) -> Array:
    """Return the largest error [V] within a number of steps.

    Parameters
    ----------
    scheme : Scheme
        Integration scheme.
    z : ndarray
        Step over time constant [1], any shape.
    steps : int, default STEPS
        Number of steps.

    Returns
    -------
    ndarray
        Largest error [V], of the shape of `z`; inf where it grows without bound.
    """
    lag, worst = np.ones_like(z), np.zeros_like(z)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, steps + 1):
            lag = scheme.advance(lag, z)
            worst = np.fmax(worst, np.abs(lag - scheme.exact(k * z)))
    worst[~np.isfinite(lag)] = math.inf
    return worst


def remaining_error(scheme: Scheme, z: Array, steps: int = STEPS) -> Array:
    """Return the larger error [V] of the last two steps: the error that remains after many steps.

    Parameters
    ----------
    scheme : Scheme
        Integration scheme.
    z : ndarray
        Step over time constant [1], any shape.
    steps : int, default STEPS
        Number of steps.

    Returns
    -------
    ndarray
        Remaining error [V], of the shape of `z`.
    """
    lag, before = np.ones_like(z), np.ones_like(z)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            before, lag = lag, scheme.advance(lag, z)
        ends = [np.abs(before - scheme.exact((steps - 1) * z)), np.abs(lag - scheme.exact(steps * z))]
    return np.nan_to_num(np.maximum(*ends), nan=math.inf, posinf=math.inf)


def first_step_beyond(scheme: Scheme, error: float) -> float:
    """Return the smallest z at which the largest error exceeds a limit.

    Parameters
    ----------
    scheme : Scheme
        Integration scheme.
    error : float
        Limit [V].

    Returns
    -------
    float
        z [1], of 200 per decade; NaN when the error never exceeds the limit.
    """
    z = np.logspace(-9, 12, 21 * 200 + 1)
    beyond = np.flatnonzero(largest_error(scheme, z) > error)
    return float(z[beyond[0]]) if beyond.size else math.nan
