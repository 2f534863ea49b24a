"""What was known of the zeros a moment ago: a press is noticed late, and until then it is taken for drift.

Corrections of the last blocks are kept, so that a taxel that turns out to be touched can be put back to where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

BLOCKS: Final = 12
"""Blocks that are remembered."""


@dataclass(frozen=True)
class Zeros:
    """What an observer knows of its taxels, each of shape [rows * cols]."""

    offset: NDArray[np.float64]
    """[N]"""
    variance: NDArray[np.float64]
    """Of the force's error [N2]."""
    covariance: NDArray[np.float64]
    """Of the force's and the offset's error [N2]."""
    offset_variance: NDArray[np.float64]
    """[N2]"""
    shift: NDArray[np.float64]
    """Sum of all corrections of the force up to now, and of what the offsets in use took off it [N]."""
    time: float
    """When that was [s]."""


class ZeroHistory:
    """The zeros of the last `BLOCKS` blocks, written over and over."""

    def __init__(self, taxels: int) -> None:
        self._entries = [_nothing(taxels) for _ in range(BLOCKS)]
        self._next = 0
        self._filled = 0

    def keep(self, zeros: Zeros) -> None:
        """Remember a state; its arrays are copied."""
        entry = self._entries[self._next]
        for mine, given in (
            (entry.offset, zeros.offset),
            (entry.variance, zeros.variance),
            (entry.covariance, zeros.covariance),
            (entry.offset_variance, zeros.offset_variance),
            (entry.shift, zeros.shift),
        ):
            mine[:] = given
        self._entries[self._next] = Zeros(
            entry.offset, entry.variance, entry.covariance, entry.offset_variance, entry.shift, zeros.time
        )
        self._next = (self._next + 1) % BLOCKS
        self._filled = min(self._filled + 1, BLOCKS)

    def forget(self) -> None:
        """Begin anew."""
        self._filled = 0

    def oldest(self) -> Zeros | None:
        """Return the oldest state that is remembered, None when there is none."""
        return self._entries[(self._next - self._filled) % BLOCKS] if self._filled else None


def _nothing(taxels: int) -> Zeros:
    arrays = [np.zeros(taxels) for _ in range(5)]
    return Zeros(arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], 0.0)
