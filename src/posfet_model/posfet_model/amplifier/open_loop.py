# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Open-loop response of an op-amp, two poles and a zero, and the follower that it makes in unity feedback.

    A(s) = A0*(1 + s*tz)/((1 + s*t1)*(1 + s*t2)),    H = A/(1 + A) = A0/(1 + A0) * (1 + s*tz)/(1 + a1*s + a2*s^2),

    a1 = (t1 + t2 + A0*tz)/(1 + A0),    a2 = t1*t2/(1 + A0)

with the time constants ``t = 1/(2*pi*f)`` of poles and zero. A zero in the left half-plane (a resistor in series with
the compensation capacitor) has a positive frequency, one in the right half-plane (the feed-forward through that
capacitor) a negative one. Source: Gray, Hurst, Lewis, Meyer, *Analysis and Design of Analog Integrated Circuits*, 5th
ed., ch. 9. All fields may be arrays, which broadcast: thousands of designs are evaluated at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.types import Array, FloatArray, Mask
from posfet_model._lib.validation import real_array
from posfet_model.amplifier.closed_loop import FREQUENCY_RANGE
from posfet_model.amplifier.step_response import StepResponse
from posfet_model.amplifier.validity import Validity

LEAST_PHASE_MARGIN: Final = 45.0
"""Phase margin [degrees] below which a design is not valid, a usual minimum."""

MOST_OVERSHOOT: Final = 0.10
"""Overshoot of a step [1] above which a design is not valid; two poles overshoot so at a phase margin of 59 degrees."""

UNSTABLE: Final = "unstable: the follower oscillates"
LOW_MARGIN: Final = f"phase margin below {LEAST_PHASE_MARGIN:g} degrees"
RINGS: Final = f"a step overshoots by more than {100 * MOST_OVERSHOOT:g} %"

GAIN_RANGE: Final = (1e-3, 1e9)
"""Accepted open-loop gains."""

_MARGIN_RANGE: Final = (-89.0, 179.0)


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """Gain, two poles and a zero of an op-amp without feedback; numbers or arrays, which broadcast."""

    gain: float | FloatArray
    """A0, the gain at frequency 0 [V/V], in [1e-3, 1e9]."""
    poles: tuple[float | FloatArray, float | FloatArray]
    """Dominant and second pole [Hz], in [1e-12, 1e15]; the second may be inf: none."""
    zero: float | FloatArray = math.inf
    """Zero [Hz]: positive in the left half-plane, negative in the right one, magnitude in [1e-12, inf]; inf: none."""

    def __post_init__(self) -> None:
        real_array("gain", self.gain, *GAIN_RANGE)
        if not isinstance(self.poles, tuple) or len(self.poles) != 2:
            raise ValueError(f"poles must be a pair of frequencies, got {self.poles!r:.60}")
        low, high = FREQUENCY_RANGE
        real_array("poles[0]", self.poles[0], low, high)
        real_array("poles[1]", _rate("poles[1]", self.poles[1]), 1 / high if np.all(np.isfinite(self.poles[1])) else 0)
        real_array("zero", np.abs(_rate("zero", self.zero)), 0, 1 / low)
        try:
            np.broadcast_shapes(*(np.shape(part) for part in (self.gain, *self.poles, self.zero)))
        except ValueError:
            raise ValueError("gain, poles and zero must be of shapes that broadcast together") from None

    @classmethod
    def from_phase_margin(cls, gain: ArrayLike, gain_bandwidth: ArrayLike, phase_margin: ArrayLike) -> OpenLoop:
        """Return the op-amp of a given gain, unity crossing and phase margin: two poles, and a zero if need be.

        With the phase lag P = 180 degrees - margin at the unity crossing w, two poles have ``x1*x2 = 1 - A0*cos(P)``,
        ``x1 + x2 = A0*sin(P)``, x = w*t. Where the margin is more than one pole leaves, the pole has ``x1 =
        A0*(sin(P) + xz*cos(P))`` and a zero in the left half-plane ``xz = (cos(P) - 1/A0)/sin(P)``. Where it is less
        than two poles of this gain have, a zero in the right half-plane mirrors the second pole: ``x1 = sqrt(A0^2 -
        1)``, ``x2 = -xz = tan((P - atan(x1))/2)``.

        Parameters
        ----------
        gain : array_like
            A0 [V/V], in [1.01, 1e9].
        gain_bandwidth : array_like
            Frequency [Hz] at which the open-loop gain is 1, in [1e-9, 1e12].
        phase_margin : array_like
            180 degrees plus the phase there [degrees], in [-89, 179].

        Returns
        -------
        OpenLoop
            The op-amp, of the broadcast shape.

        Raises
        ------
        ValueError
            An argument is not real, not finite or out of range.
        """
        a0 = real_array("gain", gain, 1.01, GAIN_RANGE[1])
        crossing = 2 * math.pi * real_array("gain_bandwidth", gain_bandwidth, 1e-9, 1e12)
        lag = np.deg2rad(180 - real_array("phase_margin", phase_margin, *_MARGIN_RANGE))
        a0, crossing, lag = np.broadcast_arrays(a0, crossing, lag)
        total, product = a0 * np.sin(lag), 1 - a0 * np.cos(lag)
        square = total * total - 4 * product
        lead, flat = product <= 0, (total <= 0) | (square < 0)
        large = 0.5 * (total + np.sqrt(np.maximum(square, 0.0)))
        alone = np.sqrt(a0 * a0 - 1)
        turned = np.tan(0.5 * (lag - np.arctan(alone)))
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = (np.cos(lag) - 1 / a0) / np.sin(lag)
            slow = np.select([lead & ~flat, flat], [a0 * (np.sin(lag) + ahead * np.cos(lag)), alone], large)
            fast = np.select([lead & ~flat, flat], [0.0, turned], product / large)
            zero = np.select([lead & ~flat, flat], [ahead, -turned], 0.0)
            first, second, third = (crossing / (2 * math.pi * part) for part in (slow, fast, zero))
        return cls(first * 0 + a0, (first, second), third)

    @property
    def pole_times(self) -> tuple[Array, Array]:
        """Time constants of the poles [s]; 0 for a pole at inf."""
        first, second = (_rate("poles", pole) / (2 * math.pi) for pole in self.poles)
        return np.asarray(first), np.asarray(second)

    @property
    def zero_time(self) -> Array:
        """Time constant of the zero [s], negative in the right half-plane; 0 without a zero."""
        return np.asarray(_rate("zero", self.zero) / (2 * math.pi))

    @property
    def gain_db(self) -> Array:
        """A0 [dB]."""
        return np.asarray(20 * np.log10(self.gain))

    @property
    def gain_pole_product(self) -> Array:
        """A0 times the dominant pole [Hz]: the unity crossing if there were only this pole, and A0 were large."""
        return np.asarray(np.multiply(self.gain, self.poles[0]))

    @property
    def gain_bandwidth(self) -> Array:
        """Unity crossing [Hz], at which the open-loop gain is 1; NaN where it never is."""
        # The positive root x = w^2 of (1 + x*t1^2)*(1 + x*t2^2) = A0^2*(1 + x*tz^2), written without cancellation.
        gain = np.asarray(self.gain, np.float64)
        (t1, t2), tz = self.pole_times, self.zero_time
        a, b, c = (t1 * t2) ** 2, t1 * t1 + t2 * t2 - (gain * tz) ** 2, gain * gain - 1
        root = np.sqrt(b * b + 4 * a * np.maximum(c, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            square = np.where(b > 0, 2 * c / (b + root), (root - b) / (2 * a))
            return np.asarray(np.where((c > 0) & np.isfinite(square), np.sqrt(square), np.nan) / (2 * math.pi))

    @property
    def phase_margin(self) -> Array:
        """180 degrees plus the phase at the unity crossing [degrees]; NaN where the gain never is 1."""
        crossing = 2 * math.pi * self.gain_bandwidth
        (t1, t2), tz = self.pole_times, self.zero_time
        lag = np.arctan(crossing * t1) + np.arctan(crossing * t2) - np.arctan(crossing * tz)
        return np.asarray(180 - np.rad2deg(lag))

    @property
    def closed_loop_gain(self) -> Array:
        """Gain of the follower at frequency 0, A0/(1 + A0) [V/V]."""
        return np.asarray(1 / (1 + 1 / np.asarray(self.gain, np.float64)))

    @property
    def step_response(self) -> StepResponse:
        """Step response of the follower, in units of its final value."""
        gain = np.asarray(self.gain, np.float64)
        (t1, t2), tz = self.pole_times, self.zero_time
        return StepResponse((t1 + t2 + gain * tz) / (1 + gain), t1 * t2 / (1 + gain), tz + 0 * gain)

    @property
    def closed_loop_poles(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Poles of the follower [1/s], the slower first; unstable where a real part is positive; -inf for none."""
        slow, fast = (part.astype(np.complex128) for part in self.step_response.time_constants)
        with np.errstate(divide="ignore", invalid="ignore"):
            second: NDArray[Any] = np.where(fast == 0, complex(-math.inf), -1 / fast)
            return -1 / slow, second

    @property
    def stable(self) -> Mask:
        """Whether the follower is stable."""
        return self.step_response.stable

    @property
    def damping(self) -> Array:
        """Damping ratio of the follower [1]; below 1 it rings, below 0 it is unstable, inf with one pole."""
        return self.step_response.damping

    @property
    def overshoot(self) -> Array:
        """Overshoot of the follower's step, as a fraction of the step [1]; NaN where unstable."""
        return self.step_response.overshoot

    def settling_time(self, tolerance: float = 0.01) -> Array:
        """Return the time after which a small step of the follower stays within a tolerance.

        Parameters
        ----------
        tolerance : float, default 0.01
            Largest remaining deviation as a fraction of the step [1], in [1e-6, 0.5].

        Returns
        -------
        ndarray
            Time [s]; inf where unstable.

        Raises
        ------
        ValueError
            The tolerance is not a real number in its range.
        """
        return self.step_response.settling_time(tolerance)

    @property
    def validity(self) -> Validity:
        """Whether the follower is usable as such: stable, with phase margin, without much ringing; and why not."""
        return Validity(
            {
                UNSTABLE: ~self.stable,
                LOW_MARGIN: np.asarray(self.phase_margin < LEAST_PHASE_MARGIN),
                RINGS: np.asarray(self.overshoot > MOST_OVERSHOOT),
            }
        )

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the open-loop gain A(j*2*pi*f).

        Parameters
        ----------
        frequency : array_like
            f [Hz], in [0, 1e18]; broadcasts with the fields.

        Returns
        -------
        ndarray
            Complex gain [V/V].

        Raises
        ------
        ValueError
            A frequency is not real, not finite or out of range.
        """
        s = 2j * math.pi * real_array("frequency", frequency, 0, 1e18)
        (t1, t2), tz = self.pole_times, self.zero_time
        return np.asarray(self.gain * (1 + s * tz) / ((1 + s * t1) * (1 + s * t2)))

    def closed_loop_response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the gain of the follower, A/(1 + A).

        Parameters
        ----------
        frequency : array_like
            f [Hz], in [0, 1e18]; broadcasts with the fields.

        Returns
        -------
        ndarray
            Complex gain [V/V].

        Raises
        ------
        ValueError
            A frequency is not real, not finite or out of range.
        """
        open_loop = self.response(frequency)
        return np.asarray(open_loop / (1 + open_loop))


def _rate(name: str, frequency: ArrayLike) -> Array:
    """Return 1/frequency [s], 0 for inf; refuses what is no real number, 0 and NaN."""
    value = np.asarray(frequency)
    if np.ma.isMaskedArray(frequency) or value.dtype.kind not in "iuf" or np.any(np.isnan(value)) or np.any(value == 0):
        raise ValueError(f"{name} must be real numbers other than 0, inf allowed, got {frequency!r:.60}")
    return np.asarray(1 / value.astype(np.float64))
