"""Random numbers that depend on what they are for and on nothing else, so that no order of calls changes them."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What random numbers are for; each has a stream of its own, so that switching one off leaves the others alone."""

    WHITE = 1
    JITTER = 2
    HUM = 3
    GAIN = 4
    AREA = 5
    OFFSET = 6
    LEAK = 7
    FAULTS = 8
    LINE = 9
    RESETS = 10
    FLICKER = 16
    """Octave k of the 1/f noise has the stream FLICKER + k: nothing may follow."""


def generator(seed: int, stream: int, page: int = 0) -> np.random.Generator:
    """Return the generator of one page of one stream; the same arguments give the same numbers."""
    return np.random.Generator(np.random.SFC64([seed, stream, page]))
