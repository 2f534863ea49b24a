# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mains hum of the simulated board: fundamental, odd harmonics, and a slowly varying frequency."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.board_effects import BoardEffects, Draw
from posfet_sim.device.random_streams import Stream, generator

WANDER_PERIODS: Final = (7.0, 18.0, 41.0, 97.0)
"""Periods of the sines that the frequency deviation is the sum of [s]; assumed: the time scales of grid control."""


class MainsHum:
    """Mains hum as products of functions of time and of amplitudes by taxel.

    With the phase ``phi(t) = 2*pi*(f*t + integral of the frequency deviation)`` a taxel sampled d before the time t
    of the scan reads ``A*sum(r_h*sin(h*(phi(t) - 2*pi*f*d)))`` over the harmonics h = 1, 3, 5 of relative amplitude
    r_h, all in phase at time 0 (assumed). The deviation is the sum of four sines of equal amplitude and random phase,
    at most `BoardEffects.frequency_wander` in total; over the delay d of a taxel it is neglected.

    Parameters
    ----------
    amplitude : numpy.ndarray
        Amplitude A of the fundamental of each taxel, shape [taxels].
    frequency : float
        Mean frequency f [Hz].
    effects : BoardEffects
        Harmonics and deviation of the frequency.
    delay : numpy.ndarray or None
        Time d from the sampling of each taxel to the time of the scan [s], shape [taxels]; None: none.
    seed : int
        Seed of the board.
    """

    def __init__(
        self,
        amplitude: NDArray[np.float64],
        frequency: float,
        effects: BoardEffects,
        delay: NDArray[np.float64] | None,
        seed: int,
    ) -> None:
        relative = {1: 1.0, 3: effects.third_harmonic, 5: effects.fifth_harmonic}
        self._frequency = frequency
        self._delayed = delay is not None
        self._orders = [order for order, each in relative.items() if each]
        self._wander = effects.frequency_wander
        self._phases = 2 * math.pi * generator(seed, Stream.BOARD, Draw.MAINS).random(len(WANDER_PERIODS))
        rows = []
        for order in self._orders:
            if delay is None:
                rows.append(relative[order] * amplitude)
                continue
            behind = 2 * math.pi * order * frequency * delay
            rows += [relative[order] * amplitude * np.cos(behind), -relative[order] * amplitude * np.sin(behind)]
        self.rows = np.array(rows)
        """Amplitude of each function of `weights` on each taxel, as `amplitude`, shape [functions, taxels]."""

    def weights(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the functions of time.

        Parameters
        ----------
        times : numpy.ndarray
            Times of the scans [s], shape [scans].

        Returns
        -------
        numpy.ndarray
            Values [1], shape [scans, functions]; their product with `rows` is the hum.
        """
        phase = 2 * math.pi * self.cycles(times)
        functions = (np.sin, np.cos) if self._delayed else (np.sin,)
        return np.stack([function(order * phase) for order in self._orders for function in functions], axis=1)

    def cycles(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the number of cycles of the fundamental by each time.

        Parameters
        ----------
        times : numpy.ndarray
            Times [s], shape [scans].

        Returns
        -------
        numpy.ndarray
            Cycles [1], shape [scans].
        """
        cycles = self._frequency * times
        if self._wander:
            share = self._wander / len(WANDER_PERIODS)
            for period, phase in zip(WANDER_PERIODS, self._phases.tolist(), strict=True):
                rate = 2 * math.pi / period
                cycles += share / rate * (math.cos(phase) - np.cos(rate * times + phase))
        return cycles
