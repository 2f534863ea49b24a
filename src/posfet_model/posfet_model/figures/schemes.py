"""Integration schemes for a follower of one pole, good and bad, to show what each does with a given step.

Only the exact exponential is used in the model. The others live here, for the map of error in docs/stability.md.

The test: an input that jumps from 0 to 1 V and stays. With the time constant tau and the step h, everything depends on
``z = h/tau`` alone. Each scheme sees the lag l of the output, ``dl/dt = -l/tau`` with l = 1 V at the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array

STEPS: Final = 200
"""Steps after which a run of the test ends."""

SLEW_LIMIT: Final = 0.39
"""Slew rate of the clipped scheme [V per time constant]: 0.39 V of overdrive."""

BLOWN_UP: Final = 1e6
"""Error [V] from which on a scheme counts as blown up."""


@dataclass(frozen=True)
class Scheme:
    """One scheme: its name and the lag after one step."""

    name: str
    advance: Callable[[Array, Array], Array]
    """Takes lag [V] and z, returns the lag one step later [V]."""
    exact: Callable[[Array], Array]
    """The true lag [V] at a time in units of tau."""


def _decay(time: Array) -> Array:
    return np.exp(-time)


def _clipped_decay(time: Array) -> Array:
    """Return the true lag with limited slew: a straight line down to the limit, then the exponential."""
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
    """Return the largest error [V] within `steps` steps of each z, any shape; inf where it passes any bound."""
    lag, worst = np.ones_like(z), np.zeros_like(z)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, steps + 1):
            lag = scheme.advance(lag, z)
            worst = np.fmax(worst, np.abs(lag - scheme.exact(k * z)))
    worst[~np.isfinite(lag)] = math.inf
    return worst


def last_error(scheme: Scheme, z: Array, steps: int = STEPS) -> Array:
    """Return the largest error [V] of the last two steps: what has not gone after `steps` steps."""
    lag, before = np.ones_like(z), np.ones_like(z)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            before, lag = lag, scheme.advance(lag, z)
        ends = [np.abs(before - scheme.exact((steps - 1) * z)), np.abs(lag - scheme.exact(steps * z))]
    return np.nan_to_num(np.maximum(*ends), nan=math.inf, posinf=math.inf)


def first_step_beyond(scheme: Scheme, error: float) -> float:
    """Return the smallest z, of 200 a decade, at which the largest error passes `error` [V]; NaN when none does."""
    z = np.logspace(-9, 12, 21 * 200 + 1)
    beyond = np.flatnonzero(largest_error(scheme, z) > error)
    return float(z[beyond[0]]) if beyond.size else math.nan
