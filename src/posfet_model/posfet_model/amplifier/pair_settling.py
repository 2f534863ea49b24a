# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Settling of a follower made of a square-law differential pair and a capacitor, exact over steps of any length.

The follower obeys ``dy/ds = slope - f(x)`` in units of its small-signal time constant, where y is the lag of the
capacitor behind the input. The pair has the overdrive x, which is less than y by the direct contribution of its current
to the output (`differential_pair.Lead`): ``y = x + linear*f(x) + square*f(x)**2``. The equation has a solution in
elementary functions, derived below; this makes steps of any length exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.first_order import linear_recurrence, mean_decay
from posfet_model._lib.types import Array
from posfet_model.amplifier.differential_pair import (
    EDGE,
    LARGEST_PRODUCT,
    NO_LEAD,
    Lead,
    bracketed_newton,
    lead_slope,
    pair_current,
    pair_transconductance,
)

LINEAR_BELOW: Final = 1e-5
"""Where |x| and |slope| are below this, f(x) = x is used: the error of x is then under 1.3e-16."""

_SQUARE_BELOW: Final = 1e-8  # the same where the lead has a square, whose share grows in proportion to x
_JUMP: Final = 1e-16  # a step so short [time constants] that the pair cannot move the output
_AT_REST: Final = 1e-6
_BLOCK_ELEMENTS: Final = 4096
_SERIES_ITERATIONS: Final = 25
_SERIES_TOLERANCE: Final = 1e-14
_MAX_LOG_DECREASE: Final = 300.0  # of the angle: at most 20 until it is exponential, and then at most _SETTLED
_SETTLED: Final = 60.0  # time constants at rest after which the distance from rest, exp(-60), counts as zero


def settle(overdrive: Array, change: Array, duration: Array, lead: Lead = NO_LEAD) -> Array:
    """Return x at the end of a step in which the input changed linearly by `change` [Vov].

    Exact solution of ``dy/ds = change/duration - f(x)`` over `duration` [time constants].

    Parameters
    ----------
    overdrive : ndarray
        x at the start of the step [Vov].
    change : ndarray
        Change of the input over the step [Vov].
    duration : ndarray
        Length of the step [time constants], >= 0; 0 is a jump. All three broadcast and are finite; unchecked.
    lead : Lead, default NO_LEAD
        Direct contribution of the pair's current to the output.

    Returns
    -------
    ndarray
        x at the end of the step [Vov], of the broadcast shape.

    Notes
    -----
    The equation is odd, but for the lead's square, which changes sign with x, so a slope >= 0 is assumed. In saturation
    the solution is a straight line. Between, with x = 2*sin(a), f = sin(2*a), p = sin(a) - cos(a) and q = sin(a) +
    cos(a), the time without a lead is ``ds = dp/(slope - 1 + p^2) + dq/(slope + 1 - q^2)``, which integrates to
    logarithms (and an arc tangent where slope > 1). The lead adds ``(linear + 2*square*f)*df/(slope - f)``, whose
    integral is ``-(linear + 2*square*slope)*ln|slope - f| - 2*square*f``. x follows from the time by bracketed Newton's
    method.
    """
    overdrive, change, duration = np.broadcast_arrays(overdrive, change, duration)  # read-only views
    slope = _slope(change, duration)
    below = _linear_below(lead)
    linear = (np.abs(overdrive) <= below) & (np.abs(slope) <= below)
    jump = duration <= _JUMP
    eased = duration / (1 + lead.linear)
    result = overdrive * np.exp(-eased) + change / (1 + lead.linear) * mean_decay(eased)
    result = np.where(jump, _jumped(overdrive, change, lead), result)
    curved = ~(linear | jump)
    if curved.any():
        result[curved] = _settle_curved(overdrive[curved], slope[curved], duration[curved], lead)
    return result


def _linear_below(lead: Lead) -> float:
    return _SQUARE_BELOW if lead.square else LINEAR_BELOW


def _lag(overdrive: Array, lead: Lead) -> Array:
    """Return y at x."""
    return overdrive if lead.absent else overdrive + lead.added(pair_current(overdrive).astype(np.float64, copy=False))


def _jumped(overdrive: Array, change: Array, lead: Lead) -> Array:
    """Return x after a jump of the input: the capacitor holds its voltage."""
    return lead.overdrive(_lag(overdrive, lead) + change)


def settle_series(start: Array, change: Array, duration: Array, lead: Lead = NO_LEAD) -> Array:
    """Return x at the end of each of many consecutive steps, the first from `start`: `settle` for all rows at once.

    Parameters
    ----------
    start : ndarray
        x at the start of the first step [Vov], of the shape of one row.
    change : ndarray
        Change of the input over each step [Vov], shape [t] or [t, n], t >= 1.
    duration : ndarray
        Length of each step [time constants], of the shape of `change`; unchecked.
    lead : Lead, default NO_LEAD
        Direct contribution of the pair's current to the output.

    Returns
    -------
    ndarray
        x at the end of each step [Vov], of the shape of `change`.

    Notes
    -----
    The initial guess of all rows is the linear solution. Each iteration of Newton's method on the whole series then
    solves a linear recurrence; its derivatives of the later y by the earlier one lie in [0, 1]. Blocks keep the guess
    close.
    """
    result = np.empty_like(change)
    row = start
    rows = max(1, _BLOCK_ELEMENTS // max(1, start.size))
    for begin in range(0, len(change), rows):
        block = slice(begin, begin + rows)
        result[block] = _settle_block(row, change[block], duration[block], lead)
        row = result[block][-1]
    return result


def _settle_block(start: Array, change: Array, duration: Array, lead: Lead) -> Array:
    """Return `settle_series` of one block; halve the block if Newton's method does not converge."""
    if len(change) == 1:
        return settle(start, change, duration, lead)
    slope = _slope(change, duration)
    eased = duration / (1 + lead.linear)
    x = linear_recurrence(np.exp(-eased), change / (1 + lead.linear) * mean_decay(eased), start)
    largest = max(np.max(np.abs(part), initial=0.0) for part in (x, start, slope))
    if largest <= _linear_below(lead):
        return np.asarray(x)
    for _ in range(_SERIES_ITERATIONS):
        before = np.concatenate([start[None], x[:-1]])
        after = settle(before, change, duration, lead)
        if np.all(np.abs(after - x) <= _SERIES_TOLERANCE * (1 + np.abs(after))):
            return after
        lag = _lag(x, lead)
        missing = linear_recurrence(
            _sensitivity(before, after, slope, duration), _lag(after, lead) - lag, np.zeros_like(start)
        )
        x = lead.overdrive(lag + missing)
    half = len(change) // 2
    first = _settle_block(start, change[:half], duration[:half], lead)
    return np.concatenate([first, _settle_block(first[-1], change[half:], duration[half:], lead)])


def _sensitivity(before: Array, after: Array, slope: Array, duration: Array) -> Array:
    """Return d(after)/d(before) of a step, for y: the ratio of its speeds, as the equation is autonomous."""
    speed = slope - pair_current(before)
    moving = (np.abs(speed) > _AT_REST) & (duration > _JUMP)
    ratio = (slope - pair_current(after)) / np.where(moving, speed, 1.0)
    return np.clip(np.where(moving, ratio, np.exp(-duration * pair_transconductance(before))), 0.0, 1.0)


def _slope(change: Array, duration: Array) -> Array:
    """Return the slope of the input [Vov per time constant]; 0 for a jump, which has none."""
    jump = duration <= _JUMP
    return np.asarray(np.where(jump, 0.0, change / np.where(jump, 1.0, duration)))


@dataclass(frozen=True, eq=False)
class _ElementLead:
    """The lead of each element, its sign changing with x."""

    linear: float
    square: Array
    absent: bool
    """Whether there is no lead, so that its contribution is not computed."""

    def of(self, part: NDArray[np.bool_]) -> _ElementLead:
        """Return the lead of some elements."""
        return _ElementLead(self.linear, self.square[part], self.absent)

    def time(self, logarithm: Array, current: Array, rho: Array) -> Array:
        """Return the contribution of the lead to the time, from ln|slope - f| and f, up to constants."""
        return np.asarray(-(self.linear + 2 * self.square * rho) * logarithm - 2 * self.square * current)

    def time_between(self, current: Array, missing: Array, change: Array) -> Array:
        """Return the contribution of the lead to the time from f = `current` to ``current - change``.

        `missing` is slope - current. As `time`, with the square's two terms, nearly opposite at a large slope, written
        with ln(1 + z) - z.
        """
        z = np.maximum(change / missing, 1e-16 - 1)
        logarithm = np.log1p(z)
        bent = missing * _log1p_minus(z, logarithm) + current * logarithm
        return np.asarray(-self.linear * logarithm - 2 * self.square * bent)

    def lead_slope(self, angle: Array) -> Array:
        """Return dy/dx at x = 2*sin(angle)."""
        if self.absent:
            return np.ones(())
        return lead_slope(self.linear, self.square, np.sin(2 * angle), np.cos(2 * angle) / np.cos(angle))


def _log1p_minus(z: Array, logarithm: Array) -> Array:
    """Return ln(1 + z) - z, z > -1, from z and ln(1 + z); for small z by ln(1 + z) = 2*artanh(w), w = z/(2 + z)."""
    w = z / (2 + z)
    series = np.zeros_like(z)
    for n in range(27, 1, -2):
        series = w * w * (1 / n + series)
    return np.asarray(np.where(np.abs(z) < 0.4, w * (2 * series - z), logarithm - z))


def _settle_curved(x: Array, slope: Array, duration: Array, lead: Lead) -> Array:
    """Return x after `duration` of ``dy/ds = slope - f(x)``, one-dimensional arrays."""
    sign = np.where(slope < 0, -1.0, 1.0)
    x, rho = x * sign, np.abs(slope)
    x, left = _leave_lower_saturation(x, rho, duration)
    x, left = _leave_upper_saturation(x, rho, left)
    ahead = _ElementLead(lead.linear, lead.square * sign, lead.absent)
    for part, inner in ((left > 0) & (rho < 1), _approach_rest), ((left > 0) & (rho >= 1), _approach_saturation):
        if part.any():
            x[part] = inner(x[part], rho[part], left[part], ahead.of(part))
    return x * sign


def _leave_lower_saturation(x: Array, rho: Array, left: Array) -> tuple[Array, Array]:
    """Advance x below -EDGE with dx/ds = rho + 1; return x and the remaining time."""
    below = x < -EDGE
    needed = np.where(below, (-EDGE - x) / (rho + 1), 0.0)
    arrived = needed <= left
    moved = np.where(arrived, -EDGE, x + (rho + 1) * left)
    return np.where(below, moved, x), np.where(below, np.where(arrived, left - needed, 0.0), left)


def _leave_upper_saturation(x: Array, rho: Array, left: Array) -> tuple[Array, Array]:
    """Advance x above EDGE with dx/ds = rho - 1: up without end, or down to EDGE; return x and the remaining time."""
    above = x >= EDGE
    falling = above & (rho < 1)
    needed = np.where(falling, (x - EDGE) / np.where(falling, 1 - rho, 1.0), np.inf)
    arrived = needed <= left
    moved = np.where(arrived, EDGE, x + (rho - 1) * left)
    remaining = np.where(arrived, left - np.where(arrived, needed, 0.0), 0.0)
    return np.where(above, moved, x), np.where(above, remaining, left)


def _approach_rest(x: Array, rho: Array, duration: Array, ahead: _ElementLead) -> Array:
    """Return x after `duration` inside [-EDGE, EDGE] for 0 <= slope < 1, where it tends to f(x) = slope.

    The unknown is the logarithm of the angle from rest, which decreases nearly in proportion to time.
    """
    a, b = np.sqrt(1 - rho), np.sqrt(1 + rho)
    rest = 0.5 * np.arctan2(rho, a * b)
    angle = np.arcsin(x / 2) - rest
    rate = a * b / np.cos(rest) / ahead.lead_slope(rest)
    moving = (angle != 0) & (duration * rate < _SETTLED)
    angle[~moving] = 0
    if moving.any():
        approach = _Approach(a[moving], b[moving], rho[moving], rest[moving], ahead.of(moving))
        angle[moving] = _angle_later(angle[moving], duration[moving], (duration * rate)[moving], approach)
    return np.asarray(2 * np.sin(rest + angle))


@dataclass(frozen=True, eq=False)
class _Approach:
    """Parameters of an approach to rest: a^2 = 1 - slope, b^2 = 1 + slope, the slope, the angle of rest, the lead."""

    a: Array
    b: Array
    rho: Array
    rest: Array
    ahead: _ElementLead

    def speed(self, angle: Array) -> Array:
        """Return cos(2*rest + angle) at `angle` from rest: slope - f is -2*sin(angle) times it."""
        return np.asarray(self.a * self.b * np.cos(angle) - self.rho * np.sin(angle))

    def time(self, angle: Array) -> Array:
        """Return the time, from an arbitrary origin, at which x is at `angle` from rest."""
        time = _time_at(angle, self.a, self.b)
        if self.ahead.absent:
            return time
        logarithm = np.log(2 * self.speed(angle) * np.abs(np.sin(angle)))
        return time + self.ahead.time(logarithm, np.sin(2 * (self.rest + angle)), self.rho)


def _angle_later(angle: Array, duration: Array, guess: Array, approach: _Approach) -> Array:
    """Return the angle from rest after `duration`; `guess` is an estimate of the decrease of its logarithm."""
    target = approach.time(angle) + duration

    def residual(decrease: Array) -> tuple[Array, Array]:
        now = angle * np.exp(-decrease)
        lead_slope = approach.ahead.lead_slope(approach.rest + now)
        derivative = now / np.sin(now) * np.cos(approach.rest + now) / approach.speed(now) * lead_slope
        return approach.time(now) - target, derivative

    # Without a lead the angle never decreases faster than exp(-2*s); a square may accelerate it.
    high = 2 * duration / (1 - 2 * LARGEST_PRODUCT * np.abs(approach.ahead.square)) + 1e-300
    high = np.minimum(high, _MAX_LOG_DECREASE)
    decrease = bracketed_newton(residual, np.zeros_like(high), high, np.minimum(guess, high))
    return np.asarray(angle * np.exp(-decrease))


def _time_at(angle: Array, a: Array, b: Array) -> Array:
    """Return the time, from an arbitrary origin, at which x is at `angle` from rest, a^2 = 1 - slope, b^2 = 1 + slope.

    Written with the distances of p from -a and of q from b, which are accurate however close x is to rest.
    """
    half_sine, half_cosine = np.sin(angle / 2), np.cos(angle / 2)
    from_p = 2 * half_sine * (b * half_cosine + a * half_sine)
    from_q = 2 * half_sine * (b * half_sine - a * half_cosine)
    # |1 - 2*a/from_p| as 1 + something small where a is small, on either side of rest.
    in_p = np.log1p(np.where(from_p < 0, -2 * a, 2 * (a - from_p)) / from_p) / (2 * a)
    in_q = np.log(np.abs((2 * b - from_q) / from_q)) / (2 * b)
    return np.asarray(in_p + in_q)


def _approach_saturation(x: Array, rho: Array, duration: Array, ahead: _ElementLead) -> Array:
    """Return x after `duration` from inside [-EDGE, EDGE] for slope >= 1, where it ends in saturation."""
    c, b = np.maximum(np.sqrt(rho - 1), 1e-160), np.sqrt(1 + rho)
    angle = np.arcsin(x / 2)
    p_start, q_start = np.sin(angle) - np.cos(angle), np.sin(angle) + np.cos(angle)

    def time_to(p: Array, q: Array) -> Array:
        # b, q and its start may be one number but for the rounding of sin and cos.
        ahead_of_q = np.maximum(b * b - q * q_start, 1e-300)
        in_q = np.minimum(b * np.maximum(q - q_start, 0) / ahead_of_q, 1 - 1e-16)
        time = np.arctan2(c * (p - p_start), c * c + p * p_start) / c + np.arctanh(in_q) / b
        if ahead.absent:
            return np.asarray(time)
        change = (p - p_start) * (p + p_start)  # of slope - f, which is c^2 + p^2
        return np.asarray(time + ahead.time_between(1 - p_start * p_start, c * c + p_start * p_start, change))

    def residual(now: Array) -> tuple[Array, Array]:
        p, q = np.sin(now) - np.cos(now), np.sin(now) + np.cos(now)
        return time_to(p, q) - wanted, 2 * np.cos(now) / (c * c + p * p) * ahead.lead_slope(now)

    escape = time_to(np.zeros_like(x), np.full_like(x, EDGE))
    wanted = np.where(duration < escape, duration, 0.0)
    inside = 2 * np.sin(bracketed_newton(residual, angle, np.full_like(x, math.pi / 4), angle))
    return np.asarray(np.where(duration < escape, inside, EDGE + (rho - 1) * (duration - escape)))
