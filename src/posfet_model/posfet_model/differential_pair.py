"""The differential pair of square-law transistors, and how a capacitor follows through it.

With the tail current I and two transistors of gain factor beta, the overdrive at balance is `Vov = sqrt(I/beta)`. In
units of I and Vov the difference of the drain currents is

    f(x) = x*sqrt(1 - x**2/4)   for |x| <= sqrt(2),   sign(x) beyond (all of the tail current on one side).

A follower made of the pair and a capacitor obeys ``dx/ds = slope - f(x)`` in units of its small-signal time constant.
That equation has a solution in elementary functions, which is what makes steps of any length exact here.

Source: any text on the MOS pair, e.g. Gray, Hurst, Lewis, Meyer, *Analysis and Design of Analog Integrated Circuits*,
5th ed., sec. 3.5.3 (current) - the solution in time is derived below.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model.checks import FloatArray, real_array
from posfet_model.exponential import mean_decay
from posfet_model.recurrence import linear_recurrence

Float64Array = NDArray[np.float64]

EDGE: Final = math.sqrt(2)
"""Overdrive in units of Vov from which on all of the tail current flows on one side."""

LINEAR_BELOW: Final = 1e-4
"""Where |x| and |slope| are below this, f(x) = x is used: the error of x is then under 1.3e-13."""

_JUMP: Final = 1e-16  # a step so short [time constants] that the pair cannot move the output
_AT_REST: Final = 1e-6
_BLOCK_ELEMENTS: Final = 4096
_SERIES_ITERATIONS: Final = 25
_SERIES_TOLERANCE: Final = 1e-14
_ITERATIONS: Final = 60
_TOLERANCE: Final = 4e-15
_SETTLED: Final = 60.0  # time constants at rest after which the distance from rest, exp(-60), counts as none


def pair_current(overdrive: ArrayLike) -> FloatArray:
    """Return f(x), the difference of drain currents in units of the tail current, in [-1, 1]; any shape.

    overdrive x is the differential input in units of Vov, any finite number. Raises ValueError otherwise.
    """
    x = np.clip(real_array("overdrive", overdrive), -EDGE, EDGE)
    return x * np.sqrt(1 - x * x / 4)


def pair_transconductance(overdrive: ArrayLike) -> FloatArray:
    """Return f'(x), the transconductance in units of I/Vov, in [0, 1]; any shape; arguments as in `pair_current`."""
    x = np.clip(real_array("overdrive", overdrive), -EDGE, EDGE)
    return np.maximum(1 - x * x / 2, 0) / np.sqrt(1 - x * x / 4)  # EDGE**2/2 rounds to more than 1


def settle(overdrive: Float64Array, change: Float64Array, duration: Float64Array) -> Float64Array:
    """Return x at the end of a step in which the input moved by `change` [Vov] in a straight line.

    Exact solution of ``dx/ds = change/duration - f(x)`` over `duration` [time constants]; arrays of any shapes that
    broadcast. Unchecked inner function: finite numbers, duration >= 0 (0 is a jump).

    Notes
    -----
    The equation is odd, so a slope >= 0 is taken. Saturated stretches are straight lines. In between, with
    x = 2*sin(a), p = sin(a) - cos(a) and q = sin(a) + cos(a), it reads
    ``ds = dp/(slope - 1 + p^2) + dq/(slope + 1 - q^2)``, which gives the time of each x in logarithms (and an arc
    tangent where slope > 1); x is found from the time by Newton's method, kept inside a bracket.
    """
    overdrive, change, duration = np.broadcast_arrays(overdrive, change, duration)  # read-only views
    slope = _slope(change, duration)
    linear = (np.abs(overdrive) <= LINEAR_BELOW) & (np.abs(slope) <= LINEAR_BELOW)
    jump = duration <= _JUMP
    result = np.where(jump, overdrive + change, overdrive * np.exp(-duration) + change * mean_decay(duration))
    curved = ~(linear | jump)
    if curved.any():
        result[curved] = _settle_curved(overdrive[curved], slope[curved], duration[curved])
    return result


def settle_series(start: Float64Array, change: Float64Array, duration: Float64Array) -> Float64Array:
    """Return x at the end of each of many steps, the first from `start`: `settle` in a row, over all rows at once.

    change and duration have shape [t] or [t, n], start the shape of one row; t >= 1.

    Notes
    -----
    All rows are first guessed as if f were linear. Newton's method on the whole series then solves a linear recurrence
    in each iteration; its derivatives, x later by x sooner, lie in [0, 1]. Blocks keep the guess from being far off.
    """
    result = np.empty_like(change)
    row = start
    rows = max(1, _BLOCK_ELEMENTS // max(1, start.size))
    for begin in range(0, len(change), rows):
        block = slice(begin, begin + rows)
        result[block] = _settle_block(row, change[block], duration[block])
        row = result[block][-1]
    return result


def _settle_block(start: Float64Array, change: Float64Array, duration: Float64Array) -> Float64Array:
    """Return `settle_series` of one block; halve the block if Newton's method does not arrive."""
    if len(change) == 1:
        return settle(start, change, duration)
    slope = _slope(change, duration)
    x = linear_recurrence(np.exp(-duration), change * mean_decay(duration), start)
    largest = max(np.max(np.abs(part), initial=0.0) for part in (x, start, slope))
    if largest <= LINEAR_BELOW:
        return np.asarray(x)
    for _ in range(_SERIES_ITERATIONS):
        before = np.concatenate([start[None], x[:-1]])
        after = settle(before, change, duration)
        missing = after - x
        if np.all(np.abs(missing) <= _SERIES_TOLERANCE * (1 + np.abs(after))):
            return after
        x = x + linear_recurrence(_sensitivity(before, after, slope, duration), missing, np.zeros_like(start))
    half = len(change) // 2
    first = _settle_block(start, change[:half], duration[:half])
    return np.concatenate([first, _settle_block(first[-1], change[half:], duration[half:])])


def _sensitivity(
    before: Float64Array, after: Float64Array, slope: Float64Array, duration: Float64Array
) -> Float64Array:
    """Return d(after)/d(before) of a step: the ratio of the speeds of x, whose equation does not hold time itself."""
    speed = slope - pair_current(before)
    moving = (np.abs(speed) > _AT_REST) & (duration > _JUMP)
    ratio = (slope - pair_current(after)) / np.where(moving, speed, 1.0)
    return np.clip(np.where(moving, ratio, np.exp(-duration * pair_transconductance(before))), 0.0, 1.0)


def _slope(change: Float64Array, duration: Float64Array) -> Float64Array:
    """Return the slope of the input [Vov per time constant]; 0 for a jump, which has none."""
    jump = duration <= _JUMP
    return np.asarray(np.where(jump, 0.0, change / np.where(jump, 1.0, duration)))


def _settle_curved(x: Float64Array, slope: Float64Array, duration: Float64Array) -> Float64Array:
    """Return x after `duration` of ``dx/ds = slope - f(x)``, one-dimensional arrays."""
    sign = np.where(slope < 0, -1.0, 1.0)
    x, rho = x * sign, np.abs(slope)
    x, left = _leave_lower_saturation(x, rho, duration)
    x, left = _leave_upper_saturation(x, rho, left)
    for part, inner in ((left > 0) & (rho < 1), _approach_rest), ((left > 0) & (rho >= 1), _run_away):
        if part.any():
            x[part] = inner(x[part], rho[part], left[part])
    return x * sign


def _leave_lower_saturation(
    x: Float64Array, rho: Float64Array, left: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Move x below -EDGE up with dx/ds = rho + 1; return x and the time that is left."""
    below = x < -EDGE
    needed = np.where(below, (-EDGE - x) / (rho + 1), 0.0)
    arrived = needed <= left
    moved = np.where(arrived, -EDGE, x + (rho + 1) * left)
    return np.where(below, moved, x), np.where(below, np.where(arrived, left - needed, 0.0), left)


def _leave_upper_saturation(
    x: Float64Array, rho: Float64Array, left: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Move x from EDGE on with dx/ds = rho - 1: up for good, or down to EDGE; return x and the time that is left."""
    above = x >= EDGE
    falling = above & (rho < 1)
    needed = np.where(falling, (x - EDGE) / np.where(falling, 1 - rho, 1.0), np.inf)
    arrived = needed <= left
    moved = np.where(arrived, EDGE, x + (rho - 1) * left)
    remaining = np.where(arrived, left - np.where(arrived, needed, 0.0), 0.0)
    return np.where(above, moved, x), np.where(above, remaining, left)


def _approach_rest(x: Float64Array, rho: Float64Array, duration: Float64Array) -> Float64Array:
    """Return x after `duration` inside [-EDGE, EDGE] for 0 <= slope < 1, where it tends to f(x) = slope.

    The unknown is the logarithm of the angle from rest, which falls nearly in proportion to time.
    """
    a, b = np.sqrt(1 - rho), np.sqrt(1 + rho)
    rest = 0.5 * np.arctan2(rho, a * b)
    angle = np.arcsin(x / 2) - rest
    rate = a * b / np.cos(rest)
    moving = (angle != 0) & (duration * rate < _SETTLED)
    angle[~moving] = 0
    if moving.any():
        scaled = duration[moving] * rate[moving]
        angle[moving] = _angle_later(
            angle[moving], duration[moving], scaled, a[moving], b[moving], rho[moving], rest[moving]
        )
    return np.asarray(2 * np.sin(rest + angle))


def _angle_later(
    angle: Float64Array,
    duration: Float64Array,
    guess: Float64Array,
    a: Float64Array,
    b: Float64Array,
    rho: Float64Array,
    rest: Float64Array,
) -> Float64Array:
    """Return the angle from rest after `duration`; `guess` is how far its logarithm may have fallen."""
    target = _time_at(angle, a, b) + duration

    def lateness(fallen: Float64Array) -> tuple[Float64Array, Float64Array]:
        now = angle * np.exp(-fallen)
        speed = a * b * np.cos(now) - rho * np.sin(now)
        return _time_at(now, a, b) - target, now / np.sin(now) * np.cos(rest + now) / speed

    high = 2 * duration + 1e-300  # the angle never falls faster than exp(-2*s)
    fallen = _newton(lateness, np.zeros_like(high), high, np.minimum(guess, high))
    return np.asarray(angle * np.exp(-fallen))


def _time_at(angle: Float64Array, a: Float64Array, b: Float64Array) -> Float64Array:
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


def _run_away(x: Float64Array, rho: Float64Array, duration: Float64Array) -> Float64Array:
    """Return x after `duration` from inside [-EDGE, EDGE] for slope >= 1, where it ends in saturation."""
    c, b = np.maximum(np.sqrt(rho - 1), 1e-160), np.sqrt(1 + rho)
    angle = np.arcsin(x / 2)
    p_start, q_start = np.sin(angle) - np.cos(angle), np.sin(angle) + np.cos(angle)

    def time_to(p: Float64Array, q: Float64Array) -> Float64Array:
        in_q = np.minimum(b * (q - q_start) / (b * b - q * q_start), 1 - 1e-16)
        return np.asarray(np.arctan2(c * (p - p_start), c * c + p * p_start) / c + np.arctanh(in_q) / b)

    def lateness(now: Float64Array) -> tuple[Float64Array, Float64Array]:
        p, q = np.sin(now) - np.cos(now), np.sin(now) + np.cos(now)
        return time_to(p, q) - wanted, 2 * np.cos(now) / (c * c + p * p)

    escape = time_to(np.zeros_like(x), np.full_like(x, EDGE))
    wanted = np.where(duration < escape, duration, 0.0)
    inside = 2 * np.sin(_newton(lateness, angle, np.full_like(x, math.pi / 4), angle))
    return np.asarray(np.where(duration < escape, inside, EDGE + (rho - 1) * (duration - escape)))


def _newton(
    residual: Callable[[Float64Array], tuple[Float64Array, Float64Array]],
    low: Float64Array,
    high: Float64Array,
    guess: Float64Array,
) -> Float64Array:
    """Return the zero of an increasing function, given with its derivative, in [low, high]; one per element.

    Newton's method; a step that leaves the bracket is replaced by its middle.
    """
    for _ in range(_ITERATIONS):
        value, derivative = residual(guess)
        low = np.where(value < 0, guess, low)
        high = np.where(value > 0, guess, high)
        better = guess - value / derivative
        better = np.where((better >= low) & (better <= high), better, 0.5 * (low + high))
        done = bool(np.all(np.abs(better - guess) <= _TOLERANCE * (1 + np.abs(guess))))
        guess = better
        if done:
            break
    return guess
