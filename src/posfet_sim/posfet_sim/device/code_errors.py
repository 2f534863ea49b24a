# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Errors of the codes of the ADC: missing codes, and a bit of one taxel that is stuck."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.signal_chain import SCALE_BITS
from posfet_sim.device.board_effects import BoardEffects, Draw
from posfet_sim.device.random_streams import Stream, generator

Codes = NDArray[np.uint16]


def to_scale(codes: Codes, bits: int) -> Codes:
    """Return codes of the ADC on the 16-bit scale: the high bits are repeated in the low ones.

    Parameters
    ----------
    codes : numpy.ndarray
        Codes; changed in place.
    bits : int
        Bits of the ADC.
    """
    if bits < SCALE_BITS:
        codes[...] = codes << (SCALE_BITS - bits) | codes >> (2 * bits - SCALE_BITS)
    return codes


class CodeErrors:
    """Missing codes of the ADC and a stuck bit.

    Each code but 0 is missing with the same probability, independently (assumed; in a real converter they cluster at
    the changes of its high bits). The stuck bit is that of the data of one taxel; it is stuck at 0 or 1 at random.

    Parameters
    ----------
    effects : BoardEffects
        Fraction of missing codes, and the stuck bit; one beyond those of the ADC counts as its highest.
    bits : int
        Bits of the ADC.
    taxel : int
        Index of the taxel with the stuck bit.
    seed : int
        Seed of the board.
    """

    def __init__(self, effects: BoardEffects, bits: int, taxel: int, seed: int) -> None:
        self._bits = bits
        self._taxel = taxel
        self._mask = self._value = 0
        if effects.stuck_bit:
            self._mask = 1 << min(effects.stuck_bit, bits - 1)
            self._value = self._mask * int(generator(seed, Stream.BOARD, Draw.STUCK_BIT).integers(2))
        self._read: Codes | None = None
        if effects.missing_codes:
            codes = np.arange(1 << bits)
            random = generator(seed, Stream.BOARD, Draw.MISSING_CODES).random(codes.size)
            present = np.where(random >= effects.missing_codes, codes, 0)
            self._read = np.maximum.accumulate(present).astype(np.uint16)

    @staticmethod
    def is_on(effects: BoardEffects) -> bool:
        """Return whether any of the effects is an error of the codes."""
        return bool(effects.stuck_bit or effects.missing_codes)

    def convert(self, codes: Codes) -> Codes:
        """Return the codes that the ADC gives: the next lower one in place of one that is missing."""
        return codes if self._read is None else self._read.take(codes)

    def stick(self, counts: Codes) -> None:
        """Set the stuck bit in counts on the 16-bit scale, shape [scans, taxels], in place."""
        if self._mask:
            codes = counts[:, self._taxel] >> np.uint16(SCALE_BITS - self._bits)
            codes &= np.uint16(0xFFFF & ~self._mask)
            codes |= np.uint16(self._value)
            counts[:, self._taxel] = to_scale(codes, self._bits)
