# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""1/f noise of the simulated readout as an infinite random process: any block can be generated independently."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.random_streams import Stream, generator

FACTOR: Final = 4
"""Ratio of the spans of neighbouring octaves of the 1/f noise [1]."""
OCTAVES: Final = 10
"""Number of octaves, with spans from 4 to 4^10 scans: at 1 kHz the spectrum is 1/f down to 1 mHz, and flat below."""
_PAGE: Final = 16  # knots drawn at once


class FlickerNoise:
    """1/f noise of unit coefficient, density 1/f [1/Hz], on `taxels` independent channels.

    The noise is a sum of octaves. Octave k has a Gaussian knot every 4^k scans and interpolates between two knots a and
    b as ``a*cos(pi*u/2) + b*sin(pi*u/2)``, u from 0 to 1, which has constant variance; equal variances ``ln(4)`` give
    the density 1/f with a ripple of log-period 4. Octaves longer than a block are summed at the ends of the block and
    interpolated linearly in between. Noise that the amplifier passes above half the scan rate is aliased (folded) into
    the samples as white noise of the variance `folded_variance`, which the caller adds to its own white noise. The
    spectrum is then within 1 dB of 1/f plus the folded noise, from rate/4^9 to half the rate
    (test/sim/device/test_flicker_noise.py).

    Parameters
    ----------
    seed : int
        Seed of the board.
    taxels : int
        Number of channels.
    block : int
        Scans of a block, a power of 4 in [4, 4^10].
    """

    def __init__(self, seed: int, taxels: int, block: int) -> None:
        self._seed = seed
        self._taxels = taxels
        self._block = block
        self._pages: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._fast = [octave for octave in range(1, OCTAVES + 1) if FACTOR**octave <= block]
        self._slow = [octave for octave in range(1, OCTAVES + 1) if FACTOR**octave > block]
        self._end_index = -1  # scan at which the slow octaves were summed last
        self._end: NDArray[np.float64] = np.zeros(taxels)
        self.weights = self._weights()
        """Weight of each row of `rows` in each scan of a block, shape [block, rows]."""

    @staticmethod
    def folded_variance(rate: float, bandwidth: float) -> float:
        """Return the variance of the folded noise, for a noise of unit coefficient.

        It is ``ln(2*bandwidth/rate)`` from above half the scan rate, and ``ln(4)`` for octave 0, whose span is one
        scan.

        Parameters
        ----------
        rate : float
            Scan rate [Hz].
        bandwidth : float
            Bandwidth of the amplifier [Hz].

        Returns
        -------
        float
            Variance to add as white noise [1].
        """
        return math.log(max(2 * bandwidth / rate, 1.0)) + math.log(FACTOR)

    def rows(self, number: int) -> NDArray[np.float64]:
        """Return the factor of block `number` (from scan number*block on): the noise is ``weights @ rows``.

        Parameters
        ----------
        number : int
            Number of the block.

        Returns
        -------
        numpy.ndarray
            Shape [rows, taxels].
        """
        start = number * self._block
        rows = np.empty((self.weights.shape[1], self._taxels))
        rows[0], rows[1] = self._slow_sum(start), self._slow_sum(start + self._block)
        row = 2
        for octave in self._fast:
            span = FACTOR**octave
            for knot in range(start // span, (start + self._block) // span + 1):
                rows[row] = self._knot(octave, knot)
                row += 1
        return rows

    def _weights(self) -> NDArray[np.float64]:
        position = np.arange(self._block)
        columns = [1 - position / self._block, position / self._block]  # the slow octaves, linear
        for octave in self._fast:
            span = FACTOR**octave
            angle = (position % span) / span * (math.pi / 2)
            for knot in range(self._block // span + 1):
                columns.append(
                    np.cos(angle) * (position // span == knot) + np.sin(angle) * (position // span == knot - 1)
                )
        return np.stack(columns, axis=1) * math.sqrt(math.log(FACTOR))

    def _slow_sum(self, index: int) -> NDArray[np.float64]:
        """Return the sum of the slow octaves at one scan, shape [taxels].

        The last result is cached, as the end of a block is the start of the next.
        """
        if index != self._end_index:
            total = np.zeros(self._taxels)
            for octave in self._slow:
                knot, offset = divmod(index, FACTOR**octave)
                angle = offset / FACTOR**octave * (math.pi / 2)
                total += math.cos(angle) * self._knot(octave, knot)
                total += math.sin(angle) * self._knot(octave, knot + 1)
            self._end_index, self._end = index, total
        return self._end

    def _knot(self, octave: int, knot: int) -> NDArray[np.float64]:
        """Return one knot of each channel, shape [taxels]."""
        page, row = divmod(knot, _PAGE)
        numbers: NDArray[np.float64] = self._page(octave, page)[row]
        return numbers

    def _page(self, octave: int, page: int) -> NDArray[np.float64]:
        key = (octave, page)
        if key not in self._pages:
            for old in [old for old in self._pages if old[0] == octave and abs(old[1] - page) > 1]:
                del self._pages[old]
            source = generator(self._seed, Stream.FLICKER + octave, page)
            self._pages[key] = source.standard_normal((_PAGE, self._taxels))
        return self._pages[key]
