# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Small-signal description of a voltage follower: gain and bandwidth, and the validity limits of a model of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import real_number


@dataclass(frozen=True)
class FollowerLimits:
    """Range in which a follower model is valid. The defaults impose no limit."""

    v_low: float = -math.inf
    """Lowest input voltage, offset included [V]."""
    v_high: float = math.inf
    """Highest input voltage, offset included [V]."""
    slew_rate: float = math.inf
    """Steepest slope of the output [V/s]; a linear model that exceeds it is flagged."""
    falling_slew_rate: float = math.inf
    """The same for a falling output, where that is slower [V/s]."""
    frequency: float = math.inf
    """Highest frequency [Hz] at which the response is valid, usually the first pole that the model neglects."""

    def __post_init__(self) -> None:
        for name in ("v_low", "v_high", "slew_rate", "falling_slew_rate", "frequency"):
            value = getattr(self, name)
            real = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)
            if not real or math.isnan(value):
                raise ValueError(f"{name} must be a real number, inf allowed, got {value!r:.60}")
        if not self.v_low < self.v_high:
            raise ValueError(f"v_high must be in ({self.v_low:g}, inf], got {self.v_high:g}")
        for name in ("slew_rate", "falling_slew_rate", "frequency"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be in (0, inf], got {getattr(self, name):g}")

    @property
    def any_slew(self) -> bool:
        """Whether the slope of the output is limited at all."""
        return self.slew_rate < math.inf or self.falling_slew_rate < math.inf

    def allow_slope(self, slope: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return where the amplifier can drive an output slope; unchecked.

        Parameters
        ----------
        slope : ndarray
            Slope of the output [V/s], negative when falling.

        Returns
        -------
        ndarray
            Mask, of the shape of `slope`.
        """
        return np.asarray((slope <= self.slew_rate) & (slope >= -min(self.slew_rate, self.falling_slew_rate)))


FREQUENCY_RANGE: Final = (1e-12, 1e15)
"""Accepted bandwidths [Hz]."""


@dataclass(frozen=True)
class ClosedLoop:
    """Small-signal gain and bandwidth of a follower."""

    gain: float
    """Gain at frequency 0 [V/V]."""
    bandwidth: float
    """Frequency at which the gain has fallen by 3 dB [Hz]."""


def close_loop(open_loop_gain: float, gain_bandwidth: float) -> ClosedLoop:
    """Return the follower of an op-amp with unity feedback: gain ``A0/(1 + A0)``, bandwidth ``GBW*(1 + A0)/A0``.

    Parameters
    ----------
    open_loop_gain : float
        A0 [V/V], in [1, 1e9].
    gain_bandwidth : float
        GBW [Hz], A0 times the frequency of its only pole, in [1e-12, 1e14].

    Returns
    -------
    ClosedLoop
        Gain [V/V] and bandwidth [Hz].

    Raises
    ------
    ValueError
        An argument is not a real, finite number or out of range.

    Examples
    --------
    Sec. V of the paper, 42.3 dB and 1.5 MHz:

    >>> loop = close_loop(10 ** (42.3 / 20), 1.5e6)
    >>> print(f"{loop.gain:.6f} {loop.bandwidth:.0f}")
    0.992385 1511510
    """
    a0 = real_number("open_loop_gain", open_loop_gain, 1, 1e9)
    product = real_number("gain_bandwidth", gain_bandwidth, FREQUENCY_RANGE[0], 1e14)
    return ClosedLoop(gain=a0 / (1 + a0), bandwidth=product * (1 + a0) / a0)
