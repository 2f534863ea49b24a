# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Independent random streams by purpose, so that the order of calls has no effect on the numbers."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """Purpose of random numbers. Each has its own stream, so that switching one error off leaves the others alone."""

    WHITE_TABLE = 0
    WHITE = 1
    JITTER = 2
    HUM = 3
    GAIN = 4
    AREA = 5
    OFFSET = 6
    LEAKAGE = 7
    TAXEL_FAULTS = 8
    LINK = 9
    RESETS = 10
    LEAK_DRIFT = 11
    GAIN_DRIFT = 12
    BOARD = 13
    """Drawn once for a board; the page is one of `board_effects.Draw`."""
    BURST = 14
    TELEGRAPH = 15
    FLICKER = 16
    """Octave k of the 1/f noise has the stream FLICKER + k: no other stream may follow."""


def generator(seed: int, stream: int, page: int = 0) -> np.random.Generator:
    """Return the generator of one page of one stream.

    Parameters
    ----------
    seed : int
        Seed of the board.
    stream : int
        Purpose, one of `Stream`.
    page : int
        Part of the stream; the parts are independent.

    Returns
    -------
    numpy.random.Generator
        The same arguments give the same numbers.
    """
    return np.random.Generator(np.random.SFC64([seed, stream, page]))
