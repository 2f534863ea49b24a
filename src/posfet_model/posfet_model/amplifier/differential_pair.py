# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The differential pair of square-law transistors: its current, and the lead that it adds to the output.

With the tail current I and two transistors of gain factor beta, the overdrive at balance is `Vov = sqrt(I/beta)`. In
units of I and Vov the difference of the drain currents is

    f(x) = x*sqrt(1 - x**2/4)   for |x| <= sqrt(2),   sign(x) beyond (all of the tail current on one side).

Source: any text on the MOS pair, e.g. Gray, Hurst, Lewis, Meyer, *Analysis and Design of Analog Integrated Circuits*,
5th ed., sec. 3.5.3. The settling of a follower made of the pair: `pair_settling`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import Array, FloatArray
from posfet_model._lib.validation import real_array, real_number

EDGE: Final = math.sqrt(2)
"""Overdrive in units of Vov beyond which all of the tail current flows on one side."""

LARGEST_PRODUCT: Final = 0.545
"""Upper bound of f*df/dx, whose maximum is at x = 0.815."""

_ITERATIONS: Final = 60
_TOLERANCE: Final = 4e-15


def pair_current(overdrive: ArrayLike) -> FloatArray:
    """Return f(x), the difference of the drain currents in units of the tail current, in [-1, 1].

    Parameters
    ----------
    overdrive : array_like
        x, the differential input in units of Vov [1], any finite numbers.

    Returns
    -------
    ndarray
        f(x) [1], of the shape of x.

    Raises
    ------
    ValueError
        x is not real or not finite.
    """
    x = np.clip(real_array("overdrive", overdrive), -EDGE, EDGE)
    return x * np.sqrt(1 - x * x / 4)


def pair_transconductance(overdrive: ArrayLike) -> FloatArray:
    """Return f'(x), the transconductance in units of I/Vov, in [0, 1].

    Parameters
    ----------
    overdrive : array_like
        x, the differential input in units of Vov [1], any finite numbers.

    Returns
    -------
    ndarray
        f'(x) [1], of the shape of x.

    Raises
    ------
    ValueError
        x is not real or not finite.
    """
    x = np.clip(real_array("overdrive", overdrive), -EDGE, EDGE)
    return np.maximum(1 - x * x / 2, 0) / np.sqrt(1 - x * x / 4)  # EDGE**2/2 rounds to more than 1


def lead_slope(linear: float, square: float | Array, current: Array, transconductance: Array) -> Array:
    """Return dy/dx of a lead; unchecked.

    Parameters
    ----------
    linear, square : float / float or ndarray
        Coefficients of the lead (see `Lead`) [1].
    current, transconductance : ndarray
        f(x) and f'(x) of the pair [1].

    Returns
    -------
    ndarray
        dy/dx [1].
    """
    return np.asarray(1 + (linear + 2 * square * current) * transconductance)


@dataclass(frozen=True)
class Lead:  # numpydoc ignore=PR02
    """Direct contribution of the pair's current to the output: ``linear*f + square*f**2`` [Vov].

    A resistor in series with the capacitor makes the linear part, the zero of the small-signal response. An output
    stage whose transconductance grows with its current makes the square.

    Parameters
    ----------
    linear : float
        Time constant of the zero over that of the follower [1], in [0, 1].
    square : float
        Coefficient of f**2 [1], in [-0.5, 0.5], within which y grows with x.

    Raises
    ------
    ValueError
        A value is not real, not finite or out of range.
    """

    linear: float = 0.0
    square: float = 0.0

    def __post_init__(self) -> None:
        real_number("linear", self.linear, 0, 1)
        real_number("square", self.square, -0.5, 0.5)

    @property
    def absent(self) -> bool:
        """Whether there is no lead, so that y is x."""
        return self.linear == 0 and self.square == 0

    def added(self, current: Array) -> Array:
        """Return y - x at a current of the pair; unchecked."""
        return np.asarray((self.linear + self.square * current) * current)

    def overdrive(self, lag: Array) -> Array:
        """Return x at a lag y of the capacitor; unchecked."""
        if self.absent:
            return lag
        high, low = self.linear + self.square, self.square - self.linear
        x = np.asarray(np.where(lag > 0, np.maximum(lag - high, EDGE), np.minimum(lag - low, -EDGE)))
        inside = (lag < EDGE + high) & (lag > low - EDGE)
        wanted = lag[inside]

        def residual(angle: Array) -> tuple[Array, Array]:
            current = np.sin(2 * angle)
            slope = lead_slope(self.linear, self.square, current, np.cos(2 * angle) / np.cos(angle))
            return 2 * np.sin(angle) + self.added(current) - wanted, 2 * np.cos(angle) * slope

        edge = np.full_like(wanted, math.pi / 4)
        x[inside] = 2 * np.sin(bracketed_newton(residual, -edge, edge, 0.5 * wanted / (1 + self.linear)))
        return x


NO_LEAD: Final = Lead()
"""No lead: the output is the voltage of the capacitor."""


def bracketed_newton(
    residual: Callable[[Array], tuple[Array, Array]],
    low: Array,
    high: Array,
    guess: Array,
) -> Array:
    """Return the zero of an increasing function in [low, high], element by element; unchecked.

    Newton's method; a step that leaves the bracket is replaced by bisection.

    Parameters
    ----------
    residual : callable
        Returns the function and its derivative.
    low, high : ndarray
        Bracket of each zero.
    guess : ndarray
        Initial values.

    Returns
    -------
    ndarray
        Zeros, of the shape of `guess`.
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
