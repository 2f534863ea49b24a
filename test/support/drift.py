# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Command: run the followers for 1e8 steps and report the accumulated rounding error. `make stability STEPS=1e8`.

Every step is computed, by the code that processes series (`Follower.advance_series`), with the state carried from piece
to piece; for the charge, by the two products of `propagate_first_order_hold` in sequence. The input is periodic, so
that the exact output is known at each step: a periodic part and the decay of the initial state, both from mpmath at 40
digits and in a different form than in the code. The trajectory of the pair is constructed backwards: from the
overdrives that it must pass, with the time of each section by quadrature.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mpmath
import numpy as np
from mpmath import mpf
from numpy.typing import NDArray

from posfet_model.amplifier.differential_pair import LARGEST_PRODUCT, NO_LEAD, Lead
from posfet_model.amplifier.follower import OnePoleFollower, SquareLawFollower, TwoPoleFollower
from posfet_model.amplifier.follower_base import Follower
from posfet_model.device.charge import propagate_first_order_hold

mpmath.mp.dps = 40
EPS = float(np.finfo(np.float64).eps)
PIECE = 1 << 18
LEVELS = np.array([0.25, 1.0, 0.5, -0.75, -1.0, 0.125, 0.75, 0.0])
"""One period of the input [V], exact in float32 as well; the run starts in equilibrium at the last value."""

STEEPEST = 1 / (1 - LARGEST_PRODUCT)
"""Largest change of the overdrive per lag of the capacitor, with a lead."""

RESONANT = 1 / (2 * math.pi)
"""Frequency [Hz] of 1 rad/s, so that steps are in units of the time constant."""


@dataclass(frozen=True)
class Drift:
    """Result of a run, in V for inputs of 1 V."""

    largest: float
    last: float
    bound: float


@dataclass(frozen=True)
class Case:
    """One run: its name, and a function that runs it for a number of steps."""

    name: str
    run: Callable[[int], Drift]


def _linear(follower: Follower, poles: Sequence[mpf], weights: Sequence[mpf], step: float, dtype: type) -> Case:
    """Return the case of a follower with the lag ``sum(weight*exp(-pole*t))`` after a jump, one term per pole."""
    name = f"{type(follower).__name__}{getattr(follower, 'quality', '')}, step/tau {step:g}, {dtype.__name__}"

    def run(steps: int) -> Drift:
        terms = [_term(pole, weight, mpf(step)) for pole, weight in zip(poles, weights, strict=True)]
        memory = min(float(steps), 3 / (step * float(min(abs(pole.real) for pole in poles))))
        state = follower.start(dtype(LEVELS[-1]))
        largest = last = 0.0
        done = 0
        for count in _pieces(steps):
            inputs = np.tile(LEVELS, count // LEVELS.size).astype(dtype)
            series = follower.advance_series(state, inputs, step)
            after = np.arange(done + 1, done + count + 1, dtype=np.float64)
            exact = inputs - sum(_lag(*term, after) for term in terms)
            error = np.abs(series.output.v_out - exact)
            largest, last = max(largest, float(error.max())), float(error[-1])
            state, done = series.end, done + count
        return Drift(largest, last, 1e-15 * memory + 8 * EPS)

    return Case(name, run)


def _term(pole: mpf, weight: mpf, step: mpf) -> tuple[NDArray[np.complex128], complex, complex]:
    """Return the periodic lag of one pole at each input of a period, the start of its decay, and pole*step.

    A linear section that rises by c in the time h leaves ``weight*c*(1 - exp(-p*h))/(p*h)``, which then decays.
    """
    changes = [mpf(float(c)) for c in np.diff(LEVELS, prepend=LEVELS[-1])]
    decay = mpmath.exp(-pole * step)
    left = weight * -mpmath.expm1(-pole * step) / (pole * step)
    lag = mpf(0)
    for change in changes:
        lag = lag * decay + left * change
    lag /= -mpmath.expm1(-pole * step * len(changes))  # the periodic lag
    start, periodic = -lag, []
    for change in changes:
        lag = lag * decay + left * change
        periodic.append(complex(lag))
    return np.array(periodic), complex(start), complex(pole * step)


def _lag(
    periodic: NDArray[np.complex128], start: complex, rate: complex, after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the lag of one pole after a number of steps."""
    return (np.tile(periodic, after.size // periodic.size) + start * np.exp(-rate * after)).real


def _one_pole(step: float, dtype: type) -> Case:
    return _linear(OnePoleFollower(gain=1.0, bandwidth=RESONANT), [mpf(1)], [mpf(1)], step, dtype)


def _two_poles(step: float, quality: float) -> Case:
    """l'' + l'/Q + l = 0 with l = 1, l' = 0 just after a jump of 1: weights p2/(p2 - p1) and -p1/(p2 - p1)."""
    follower = TwoPoleFollower(gain=1.0, natural_frequency=RESONANT, quality=quality)
    middle = 1 / (2 * mpf(quality))
    root = mpmath.sqrt(mpmath.mpc(middle**2 - 1))
    slow, fast = middle - root, middle + root
    return _linear(follower, [slow, fast], [fast / (fast - slow), -slow / (fast - slow)], step, np.float64)


def _charge(step: float, dtype: type) -> Case:
    """Return the case of the charge, in scalar arithmetic: the same products and sums as in the function."""
    one, none = dtype(1), dtype(0)
    changes = np.diff(LEVELS, prepend=LEVELS[-1]).astype(dtype)
    decay = propagate_first_order_hold(one, none, none, step, 1.0)[()]
    kicks = list(changes * propagate_first_order_hold(none, none, one, step, 1.0))
    if dtype is np.float64:  # the same arithmetic, three times as fast
        decay, kicks = float(decay), [float(kick) for kick in kicks]
    eps = float(np.finfo(dtype).eps)

    def run(steps: int) -> Drift:
        term = _term(mpf(1), mpf(1), mpf(step))
        largest = last = 0.0
        charge, done = none, 0
        for count in _pieces(steps):
            pushes = itertools.chain.from_iterable(itertools.repeat(kicks, count // len(kicks)))
            charges = itertools.accumulate(pushes, lambda before, kick: before * decay + kick, initial=charge)
            got = np.fromiter(charges, dtype, count + 1)[1:]
            error = np.abs(got - _lag(*term, np.arange(done + 1, done + count + 1, dtype=np.float64)))
            largest, last = max(largest, float(error.max())), float(error[-1])
            charge, done = got[-1].item() if dtype is np.float64 else got[-1], done + count
        return Drift(largest, last, 1.5 * eps * min(float(steps), 3 / step) + 8 * eps)

    return Case(f"charge, step/tau {step:g}, {dtype.__name__}", run)


def _current(x: mpf) -> mpf:
    """Return the normalised current of the pair inside saturation."""
    return x * mpmath.sqrt(1 - x * x / 4)


def _raised(x: mpf, lead: Lead) -> mpf:
    """Return the lag of the capacitor at an overdrive x."""
    return x + mpf(lead.linear) * _current(x) + mpf(lead.square) * _current(x) ** 2


def _duration(section: tuple[mpf, mpf], slope: mpf, lead: Lead) -> mpf:
    """Return the time from one overdrive to another inside saturation, by quadrature over y."""

    def pace(x: mpf) -> mpf:
        steepness = (1 - x * x / 2) / mpmath.sqrt(1 - x * x / 4)
        raised = 1 + (mpf(lead.linear) + 2 * mpf(lead.square) * _current(x)) * steepness
        return raised / (slope - _current(x))

    return mpmath.quad(pace, section)


def _pair(
    name: str, overdrives: Sequence[float], rising: float, lead: Lead = NO_LEAD, linearisation: float = 0.0
) -> Case:
    """Return the case of a square-law follower that passes the overdrives up and down again, periodically.

    The falling slope is the one that returns the input to its start.
    """

    def run(steps: int) -> Drift:
        points = [mpf(x) for x in overdrives]
        up = list(itertools.pairwise(points))
        down = [(b, a) for a, b in reversed(up)]
        times_up = [_duration(section, mpf(rising), lead) for section in up]

        def left_over(slope: mpf) -> mpf:
            return mpf(rising) * sum(times_up) + slope * sum(_duration(section, slope, lead) for section in down)

        falling = mpmath.findroot(left_over, (-mpf(rising), -mpf(rising) * mpf("0.9")), tol=1e-40)
        steps_of = [(mpf(rising), t) for t in times_up] + [
            (falling, _duration(section, falling, lead)) for section in down
        ]
        levels, level = [], _raised(points[0], lead)  # a jump from equilibrium sets the first overdrive
        for slope, duration in steps_of:
            level += slope * duration
            levels.append(float(level))
        passed = np.array([float(b) for _, b in (*up, *down)])
        follower = SquareLawFollower(gain=1.0, bandwidth=RESONANT, overdrive=1.0, lead=lead)
        state = follower.advance(follower.start(0.0), levels[-1], 0.0)
        durations = np.array([float(duration) for _, duration in steps_of])
        largest = last = 0.0
        for count in _pieces(steps, len(levels)):
            repeats = count // len(levels)
            series = follower.advance_series(state, np.tile(levels, repeats), np.tile(durations, repeats))
            error = np.abs(np.tile(np.array(levels) - passed, repeats) - series.output.v_out)
            largest, last = max(largest, float(error.max())), float(error[-1])
            state = series.end
        # Each step rounds x by 4 units, and rounds its input and its time.
        memory = 3 * max(1.0, len(levels) / float(sum(durations)))  # number of steps whose errors have not decayed
        return Drift(largest, last, 8 * EPS * STEEPEST * memory + linearisation)

    return Case(name, run)


def _pieces(steps: int, period: int = LEVELS.size) -> Iterator[int]:
    """Yield lengths of pieces of whole periods that add up to at least `steps`."""
    whole = PIECE // period * period
    left = -(-steps // period) * period
    while left > 0:
        yield min(whole, left)
        left -= whole


def cases() -> list[Case]:
    """Return all runs, the quick ones first."""
    arc = (-1.1, -0.2, 0.4, 1.1)
    return [
        *(_one_pole(step, dtype) for step in (1e-12, 1e-6, 1e-3, 1.0) for dtype in (np.float64, np.float32)),
        *(_charge(step, np.float64) for step in (1e-12, 1e-9, 1e-6, 3.7e-3)),
        *(_charge(step, np.float32) for step in (1e-3, 3.7e-3)),
        *(_two_poles(step, quality) for step in (1e-6, 0.1) for quality in (0.4, 0.7)),
        _pair("SquareLawFollower, small, float64", (-5e-6, -2e-6, 1e-6, 5e-6), 9e-6, linearisation=1.3e-16),
        _pair("SquareLawFollower, slewing, float64", arc, 1.7),
        _pair("SquareLawFollower, slewing with a lead, float64", arc, 1.7, Lead(0.07, 0.18)),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the selected cases and print a line for each; return 1 if a bound is exceeded."""
    parser = argparse.ArgumentParser(prog="drift", description=__doc__)
    parser.add_argument("--steps", type=float, default=1e8, help="steps of each run, 1e8 where not given")
    parser.add_argument("--only", default="", help="runs whose name holds this")
    options = parser.parse_args(arguments)
    broken = False
    print(f"{int(options.steps):.0e} steps each, input of 1 V")
    for case in cases():
        if options.only not in case.name:
            continue
        begin = time.perf_counter()
        found = case.run(int(options.steps))
        seconds = time.perf_counter() - begin
        broken |= not found.largest <= found.bound
        print(
            f"{case.name}: largest error {found.largest:.1e}, last {found.last:.1e}, bound {found.bound:.1e}; "
            f"{seconds:.0f} s",
            flush=True,
        )
    return int(broken)


if __name__ == "__main__":
    sys.exit(main())
