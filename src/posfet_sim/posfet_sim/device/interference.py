# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interference on the outputs of the followers: electromagnetic bursts, and random telegraph noise of one taxel."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.board_effects import BoardEffects
from posfet_sim.device.random_streams import Stream, generator

_PAGE: Final = 1024


class Interference:
    """Bursts and telegraph noise; depends on the seed and on the scan only, whatever scans are read.

    A burst (a switching inductive load, a discharge) is shorter than a scan and rings at a high frequency: each taxel
    samples it at a random phase, ``A*sin(phase)`` (assumed). The number of scans between bursts is geometric. Telegraph
    noise (a trap in the channel of one transistor that is filled and emptied) alternates between 0 and its amplitude
    after exponentially distributed times of one mean (assumed).

    Parameters
    ----------
    effects : BoardEffects
        Rates and amplitudes.
    taxels : int
        Number of taxels.
    telegraph_taxel : int
        Index of the taxel with telegraph noise.
    interval : float
        Scan interval [s].
    seed : int
        Seed of the board.
    """

    def __init__(self, effects: BoardEffects, taxels: int, telegraph_taxel: int, interval: float, seed: int) -> None:
        self._effects = effects
        self._taxels = taxels
        self._telegraph_taxel = telegraph_taxel
        self._probability = -math.expm1(-effects.burst_rate * interval) if effects.burst_amplitude else 0.0
        self._seed = seed
        self._switches: NDArray[np.float64] = np.zeros(0)  # times of the telegraph noise's next switches [s]
        self._switched = 0  # number of switches before them
        self._drawn_until = 0.0  # time of the last switch drawn [s]
        self._pages = 0

    @staticmethod
    def is_on(effects: BoardEffects) -> bool:
        """Return whether any of the effects is interference."""
        bursts = effects.burst_rate and effects.burst_amplitude
        return bool(bursts or (effects.telegraph_amplitude and effects.telegraph_dwell))

    def add(self, output: NDArray[np.float64], block: int, times: NDArray[np.float64], lsb: float) -> None:
        """Add the interference to the outputs of a block of scans.

        Parameters
        ----------
        output : numpy.ndarray
            Outputs [LSB], shape [scans, taxels]; changed in place.
        block : int
            Number of the block.
        times : numpy.ndarray
            Times of its scans [s], shape [scans].
        lsb : float
            Voltage of a least significant bit [V].
        """
        if self._probability:
            random = generator(self._seed, Stream.BURST, block)
            hit = np.flatnonzero(random.random(len(times)) < self._probability)
            if hit.size:
                phase = 2 * math.pi * random.random((hit.size, self._taxels))
                output[hit] += self._effects.burst_amplitude / lsb * np.sin(phase)
        if self._effects.telegraph_amplitude and self._effects.telegraph_dwell:
            high = self.telegraph_state(times)
            output[:, self._telegraph_taxel] += self._effects.telegraph_amplitude / lsb * high

    def telegraph_state(self, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the state of the telegraph noise.

        Parameters
        ----------
        times : numpy.ndarray
            Times [s], shape [scans], ascending, and not before those of the last call.

        Returns
        -------
        numpy.ndarray
            0 or 1 at each time; 0 at time 0.
        """
        while self._drawn_until <= times[-1]:
            random = generator(self._seed, Stream.TELEGRAPH, self._pages)
            switches = self._drawn_until + np.cumsum(random.exponential(self._effects.telegraph_dwell, _PAGE))
            self._drawn_until = switches.item(-1)
            self._pages += 1
            self._switches = np.concatenate([self._switches, switches])
            past = int(np.searchsorted(self._switches, times[0], side="right"))
            self._switches, self._switched = self._switches[past:], self._switched + past
        return (self._switched + np.searchsorted(self._switches, times, side="right")) % 2
