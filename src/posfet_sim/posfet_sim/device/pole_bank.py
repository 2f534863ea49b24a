# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parallel first-order responses on many channels, exact for piecewise linear inputs and steps of any length."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.first_order import mean_decay

NEGLIGIBLE_STATE: Final = 1e-60
"""Magnitude below which a state counts as zero, far below any signal: its further decay would meet subnormal numbers,
whose arithmetic is slow."""


class PoleBank:
    """Weighted sum of first-order responses ``sum(a_j*x_j)``, ``d(x_j)/dt = (u - x_j)/tau_j``; starts at 0, unless set.

    Its state is the lag ``y_j = u - x_j``, which over a step h obeys the equation of the charge with leakage:
    ``y1 = y0*exp(-h/tau) + (u1 - u0)*(1 - exp(-h/tau))/(h/tau)``.

    Parameters
    ----------
    time_constants : sequence of float
        tau_j [s], above 0.
    weights : sequence of float
        a_j, in the unit of the output per unit of the input.
    channels : int
        Number of channels.
    """

    def __init__(self, time_constants: Sequence[float], weights: Sequence[float], channels: int) -> None:
        self._rates = 1 / np.array(time_constants, np.float64)
        self._weights = np.array(weights, np.float64)
        self._lags = np.zeros((self._rates.size, channels))
        self._input = np.zeros(channels)

    def start_under(self, inputs: NDArray[np.float64]) -> None:
        """Start in the steady state of a constant input.

        Parameters
        ----------
        inputs : numpy.ndarray
            u, shape [channels].
        """
        self._input = inputs.copy()
        self._lags = np.zeros_like(self._lags)

    def respond(self, inputs: NDArray[np.float64], steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Advance by several samples and return the outputs.

        Parameters
        ----------
        inputs : numpy.ndarray
            u, linear between the samples, shape [samples, channels].
        steps : numpy.ndarray
            Interval since the previous sample [s], shape [samples].

        Returns
        -------
        numpy.ndarray
            Output at each sample, shape [samples, channels].
        """
        changes = np.diff(inputs, axis=0, prepend=self._input[None])
        self._input = inputs[-1].copy()
        outputs: NDArray[np.float64] = inputs * self._weights.sum()
        if not (changes.any() or self._lags.any()):
            return outputs
        ratios = np.multiply.outer(steps, self._rates)
        lags = changes[:, None, :] * mean_decay(ratios)[:, :, None]
        before = self._lags
        for left, after in zip(np.exp(-ratios)[:, :, None], lags, strict=True):
            before = np.add(after, before * left, out=after)
        self._lags = np.where(np.abs(before) < NEGLIGIBLE_STATE, 0.0, before)
        outputs -= np.matmul(self._weights, lags)
        return outputs
