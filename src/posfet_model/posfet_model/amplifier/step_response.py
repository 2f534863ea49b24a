# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Step response of two poles and a zero: stability, damping, overshoot and settling time in closed form.

    H(s) = (1 + s*tz)/(1 + a1*s + a2*s^2),    w0 = 1/sqrt(a2),    damping z = a1/(2*sqrt(a2)),    sigma = z*w0

With complex poles ``sigma +- j*wd`` the response to a unit step has its extremes at ``wd*t = k*pi - phi``, where
``phi = atan2(tz*wd, 1 - sigma*tz)``, and lies there ``M*exp(-sigma*t)`` off 1, in turn above and below, with ``M^2 =
1 - 2*sigma*tz + (w0*tz)^2``. With real poles of the time constants T1 >= T2 there is one extreme, where tz > T1:
``(tz - T1)/T1*exp(-t/T1)`` above 1. Derived from the partial fractions of H(s)/s; for tz = 0 the textbook's
``exp(-pi*z/sqrt(1 - z^2))``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import real_number

_HALVINGS: Final = 60


@dataclass(frozen=True, eq=False)
class StepResponse:
    """Two poles and a zero by their coefficients, numbers or arrays that broadcast; unchecked."""

    a1: Array
    """Coefficient of s in the denominator [s]; not positive where unstable."""
    a2: Array
    """Coefficient of s^2 [s^2], at least 0; 0 where there is one pole."""
    zero_time: Array
    """Time constant of the zero [s], negative in the right half-plane, 0 where there is none."""

    @property
    def stable(self) -> Mask:
        """Whether the response to any bounded input is bounded."""
        return np.asarray(np.asarray(self.a1) > 0)

    @property
    def damping(self) -> Array:
        """Damping ratio [1]: 1 where the poles are equal, negative where unstable, +-inf with one pole."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.a1 / (2 * np.sqrt(self.a2)))

    @property
    def time_constants(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Slow and fast time constant [s], ``-1/pole``: complex conjugates where they ring; fast is 0 with one pole."""
        # Of an unstable pair of real poles, "slow" is the one whose time constant is larger in magnitude.
        a1, a2 = np.asarray(self.a1, np.float64), np.asarray(self.a2, np.float64)
        root: NDArray[Any] = 0.25 * a1 * a1 - a2
        root = np.sqrt(root) if np.all(root >= 0) else np.sqrt(root.astype(np.complex128))
        slow = 0.5 * a1 + np.where(a1 < 0, -root, root)
        with np.errstate(divide="ignore", invalid="ignore"):
            fast = np.where(slow == 0, 0.0, a2 / slow)
        return slow, fast

    @property
    def overshoot(self) -> Array:
        """Largest excursion of a step beyond its final value, as a fraction of it; NaN where unstable."""
        sigma, turn, tz = self._turning()
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ringing = self._amplitude() * np.exp(-sigma * (math.pi - self._phase()) / turn)
            slow = np.where(turn > 0, 1.0, self._real_slow())
            single = np.where(tz > slow, (tz - slow) / slow * np.exp(-self._real_extreme() / slow), 0.0)
        return np.asarray(np.where(self.stable, np.where(turn > 0, ringing, single), np.nan))

    def at(self, time: Array) -> Array:
        """Return the response to a unit step in units of its final value; unchecked.

        Parameters
        ----------
        time : ndarray
            Time after the step [s], at least 0; broadcasts with the fields.

        Returns
        -------
        ndarray
            Response [1].
        """
        slow, fast = self.time_constants
        tz = self.zero_time
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slow_part, fast_part = np.exp(-time / slow), np.where(fast == 0, 0.0, np.exp(-time / fast))
            apart = np.abs(slow - fast) > 1e-6 * np.abs(slow)
            gap = np.where(apart, slow - fast, 1.0)
            split = ((slow - tz) * slow_part - (fast - tz) * fast_part) / gap
            joined = slow_part * (1 + (time / slow) * (1 - tz / slow))
        return np.asarray(1 - np.where(apart, split, joined).real)

    def settling_time(self, tolerance: float = 0.01) -> Array:
        """Return the time after which a step stays within a tolerance of its final value.

        Parameters
        ----------
        tolerance : float, default 0.01
            Largest remaining deviation as a fraction of the step [1], in [1e-6, 0.5].

        Returns
        -------
        ndarray
            Time [s], of the fields' shape; inf where unstable.

        Raises
        ------
        ValueError
            The tolerance is not a real number in its range.
        """
        tolerance = real_number("tolerance", tolerance, 1e-6, 0.5)
        low, high = self._last_crossing(tolerance)
        outside = np.abs(self.at(high) - 1) > tolerance
        for _ in range(_HALVINGS):
            high = np.where(outside, 2 * high, high)
            outside = np.abs(self.at(high) - 1) > tolerance
            if not np.any(outside & self.stable):
                break
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            early = np.abs(self.at(middle) - 1) > tolerance
            low, high = np.where(early, middle, low), np.where(early, high, middle)
        return np.asarray(np.where(self.stable, high, np.inf))

    def _last_crossing(self, tolerance: float) -> tuple[Array, Array]:
        """Return a bracket in which the response enters the tolerance once and for all."""
        sigma, turn, _ = self._turning()
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            extremes = np.floor((turn * np.log(self._amplitude() / tolerance) / sigma + self._phase()) / math.pi)
            last = np.maximum(np.nan_to_num(extremes), 0)
            ringing = [np.maximum((k * math.pi - self._phase()) / turn, 0.0) for k in (last, last + 1)]
            extreme = np.maximum(np.nan_to_num(self._real_extreme()), 0.0)
        extreme = np.where(np.abs(self.at(extreme) - 1) > tolerance, extreme, 0.0)
        after = np.where(turn > 0, ringing[1], extreme + np.abs(self.a1))
        return np.where(turn > 0, ringing[0], extreme), after

    def _turning(self) -> tuple[Array, Array, Array]:
        """Return sigma [1/s], wd [1/s], which is 0 with real poles, and the time constant of the zero [s]."""
        with np.errstate(divide="ignore", invalid="ignore"):
            sigma = 0.5 * self.a1 / self.a2
            square = 1 / np.asarray(self.a2) - sigma * sigma
        ringing = np.asarray(self.a1) ** 2 < 4 * np.asarray(self.a2)
        return sigma, np.sqrt(np.where(ringing, square, 0.0)), np.asarray(self.zero_time, np.float64)

    def _phase(self) -> Array:
        sigma, turn, tz = self._turning()
        with np.errstate(invalid="ignore"):
            return np.asarray(np.arctan2(tz * turn, 1 - sigma * tz))

    def _amplitude(self) -> Array:
        sigma, _, tz = self._turning()
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.sqrt(1 - 2 * sigma * tz + tz * tz / self.a2))

    def _real_slow(self) -> Array:
        return np.asarray(self.time_constants[0].real)

    def _real_extreme(self) -> Array:
        """Return the time [s] of the only extreme with real poles; NaN where there is none."""
        slow, fast = (part.real for part in self.time_constants)
        gap, tz = slow - fast, self.zero_time
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = slow * fast / gap * (np.log1p(gap / (tz - slow)) + np.log(slow / fast))
            close = slow * tz / (tz - slow)
            time = np.where(fast == 0, 0.0, np.where(gap > 1e-9 * slow, apart, close))
            return np.asarray(np.where((tz > slow) | ((tz < 0) & (fast > 0)), time, np.nan))
