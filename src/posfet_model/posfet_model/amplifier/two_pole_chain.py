# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Two poles and a zero over steps of any length, exact for a piecewise linear input: the matrix exponential as a chain.

A fast lag and a slow one behind it, of the time constants Tf and Ts (equal, or complex conjugates where they ring):

    lf' = u' - lf/Tf,    ls' = u' - (ls - lf)/Ts,    lag of the output = ls - tz*(ls - lf)/Ts

The matrix of this system is triangular, so that its exponential is exp(-h/Tf), exp(-h/Ts) and the divided difference of
both, which is written without cancellation: equal and nearly equal poles are no special case.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.first_order import linear_recurrence, mean_decay
from posfet_model._lib.types import Array
from posfet_model.amplifier.follower_base import VOLTAGE_LIMIT

_MOST_GROWTH: Final = 600.0
"""Largest exponent of an unstable pole in a step: beyond, the lag is at its limit anyway."""

_KNOWN_STEPS: Final = 256

Lags = tuple[NDArray[Any], NDArray[Any]]


@dataclass(frozen=True, eq=False)
class TwoPoleChain:
    """Time constants of the poles and of the zero [s], numbers or arrays; unchecked."""

    slow: NDArray[Any]
    """Ts; complex where the poles are, its real part negative where unstable."""
    fast: NDArray[Any]
    """Tf; 0 where there is one pole."""
    zero: Array
    """tz; 0 where there is no zero, negative in the right half-plane."""

    @cached_property
    def grows(self) -> bool:
        """Whether any of the poles is unstable."""
        return bool(np.any(self.slow.real < 0) or np.any(self.fast.real < 0))

    @cached_property
    def _of_step(self) -> dict[float, tuple[NDArray[Any], ...]]:
        """Coefficients by step: a simulation repeats few different steps."""
        return {}

    @cached_property
    def _lead(self) -> NDArray[Any] | None:
        return self.zero / self.slow if np.any(self.zero) else None

    def start(self, shape: tuple[int, ...]) -> Lags:
        """Return the lags at rest; unchecked."""
        lag: NDArray[Any] = np.zeros(shape, np.result_type(self.slow, np.float64))
        return lag, lag

    def coefficients(self, step: Array) -> tuple[NDArray[Any], ...]:
        """Return decay and input weight of the fast lag; decay, coupling and input weight of the slow one; unchecked.

        Parameters
        ----------
        step : ndarray
            Length of the step [s]; broadcasts with the time constants.

        Returns
        -------
        tuple of ndarray
            The five coefficients [1].
        """
        slow, fast = self.slow, self.fast
        single = fast == 0
        to_fast = _bounded(np.where(single, np.inf, step / np.where(single, 1.0, fast)))
        to_slow = _bounded(step / slow)
        decay_fast, decay_slow = np.exp(-to_fast), np.exp(-to_slow)
        mean_fast, mean_slow = mean_decay(to_fast), mean_decay(to_slow)
        between = decay_slow * mean_decay(_bounded(to_fast - to_slow))
        apart = np.abs(slow - fast) > np.abs(fast)
        gap = np.where(apart, slow - fast, 1.0)
        separate = mean_slow + (mean_slow - mean_fast) * (fast / gap)
        close = mean_fast + (mean_fast - between) * (slow / np.where(apart, 1.0, fast))
        return decay_fast, mean_fast, decay_slow, to_slow * between, np.where(apart, separate, close)

    def advance(self, lags: Lags, change: Array, step: Array) -> Lags:
        """Return the lags after a step in which the input changed linearly by `change` [V]; unchecked.

        Parameters
        ----------
        lags : tuple of ndarray
            Fast and slow lag [V].
        change : ndarray
            Change of the input [V].
        step : ndarray
            Length of the step [s].

        Returns
        -------
        tuple of ndarray
            Lags at the end [V]; those of an unstable pole are held at 1e6 V.
        """
        if step.ndim:
            return self._moved(lags, change, self.coefficients(step))
        known = self._of_step.get(float(step))
        if known is None:
            if len(self._of_step) >= _KNOWN_STEPS:
                self._of_step.clear()
            known = self._of_step[float(step)] = self.coefficients(step)
        return self._moved(lags, change, known)

    def _moved(self, lags: Lags, change: Array, coefficients: tuple[NDArray[Any], ...]) -> Lags:
        decay_fast, weight_fast, decay_slow, coupling, weight_slow = coefficients
        fast = lags[0] * decay_fast + change * weight_fast
        slow = lags[1] * decay_slow + lags[0] * coupling + change * weight_slow
        return (_held(fast), _held(slow)) if self.grows else (fast, slow)

    def series(self, start: Lags, change: Array, step: Array) -> Lags:
        """Return the lags after each of many steps; unchecked.

        Parameters
        ----------
        start : tuple of ndarray
            Fast and slow lag before the first step [V].
        change : ndarray
            Change of the input in each step [V], shape [t] or [t, n].
        step : ndarray
            Lengths of the steps [s], which broadcast to it.

        Returns
        -------
        tuple of ndarray
            Lags after each step [V], of the shape of `change`.
        """
        decay_fast, weight_fast, decay_slow, coupling, weight_slow = self.coefficients(step)
        if self.grows:
            parts = np.broadcast_arrays(decay_fast, weight_fast, decay_slow, coupling, weight_slow, change)
            rows, now = [], start
            for k in range(len(change)):
                now = self._moved(now, change[k], tuple(part[k] for part in parts[:5]))
                rows.append(now)
            return np.stack([row[0] for row in rows]), np.stack([row[1] for row in rows])
        fast = linear_recurrence(decay_fast, np.array(change * weight_fast), start[0])
        before = np.concatenate([start[0][None], fast[:-1]])
        return fast, linear_recurrence(decay_slow, before * coupling + change * weight_slow, start[1])

    def lag(self, lags: Lags) -> Array:
        """Return the lag of the output [V]; unchecked."""
        lag = lags[1] if self._lead is None else lags[1] + self._lead * (lags[0] - lags[1])
        return np.asarray(lag.real)

    def slope(self, lags: Lags, change: Array, step: Array) -> Array:
        """Return the slope of the output at the end of a step [V/s], the zero's contribution of the input left out.

        Unchecked.

        Parameters
        ----------
        lags : tuple of ndarray
            Fast and slow lag [V].
        change : ndarray
            Change of the input in the step [V].
        step : ndarray
            Length of the step [s].

        Returns
        -------
        ndarray
            Slope [V/s].
        """
        del change, step
        return np.asarray(((lags[1] - lags[0]) / self.slow).real)


def _bounded(ratio: NDArray[Any]) -> NDArray[Any]:
    """Return a ratio of times whose exponential does not overflow."""
    low = ratio.real < -_MOST_GROWTH
    return np.where(low, -_MOST_GROWTH + 1j * ratio.imag if np.iscomplexobj(ratio) else -_MOST_GROWTH, ratio)


def _held(lag: NDArray[Any]) -> NDArray[Any]:
    size = np.abs(lag)
    return np.asarray(np.where(size > VOLTAGE_LIMIT, lag / np.where(size > 0, size, 1.0) * VOLTAGE_LIMIT, lag))
