"""Silence on the bus between classic scans, whose counter is the same again after 16 of them."""

from __future__ import annotations

from typing import Final

from posfet_driver.assembler import QUIET_LIMIT
from posfet_driver.frames import Frame

CATCHING_UP: Final = 2.0
"""Frames that come this many times as fast as scans are acquired make up for a pause."""
PATIENCE: Final = 1.0
"""Time for which frames after a pause are held in any case [scan periods]."""
HOLD_LIMIT: Final = 50.0
"""Longest time for which frames are held until a pause is judged [scan periods]."""


class Pauses:
    """Measures silence: time for which no frames came, not even later.

    A host or an adapter that was held up finds as many frames as time went by: no silence. They may come in several
    batches, so after a pause frames are held while the rest comes in. When it does not come, the pause was silence;
    where in the batch after it the silence lies is not known, and its blocks are dropped, for they may be of two scans.
    """

    def __init__(self, first: int, last: int, blocks: int) -> None:
        """Take the identifiers of the first and the last block, and the blocks of a scan."""
        self.quiet = 0.0
        """Silence so far [scan periods]."""
        self._first = first
        self._last = last
        self._blocks = blocks
        self._arrival = 0
        self._held: list[Frame] = []
        self._elapsed = 0.0  # over the frames held
        self._scans = 0.0
        self._waited = 0.0  # since the first of them

    def skip(self, frames: list[Frame], arrival: int) -> list[Frame]:
        """Take a batch read at `arrival` [ns] while silence is of no interest; return what is to be fed."""
        self._arrival = arrival
        return self._release() + frames if self._held else frames

    def take(self, frames: list[Frame], arrival: int, period: float) -> list[Frame]:
        """Take a batch read at `arrival` [ns] at a scan period [ns]; return what is to be fed, maybe less or more."""
        elapsed = (arrival - self._arrival) / period
        first, last = self._first, self._last
        scans = sum(1 for identifier, _, _ in frames if first <= identifier <= last) / self._blocks
        self._arrival = arrival
        if self._held:
            if self._elapsed + elapsed - self._scans - scans <= QUIET_LIMIT:  # the rest has come
                self.quiet += max(self._elapsed + elapsed - self._scans - scans, 0.0)
                return self._release() + frames
            self._waited += elapsed
            if self._waited < PATIENCE or (scans > CATCHING_UP * elapsed and self._waited < HOLD_LIMIT):
                self._hold(frames, elapsed, scans)
                return []
            self.quiet += self._elapsed
            others = [frame for frame in self._release() if not first <= frame[0] <= last]
            return others + self._fresh(frames, elapsed, scans)
        return self._fresh(frames, elapsed, scans)

    def _fresh(self, frames: list[Frame], elapsed: float, scans: float) -> list[Frame]:
        """Take a batch when none is held."""
        silence = max(elapsed - scans, 0.0)
        if silence <= QUIET_LIMIT or not scans:
            self.quiet += silence
            return frames
        self._hold(frames, elapsed, scans)
        return []

    def _hold(self, frames: list[Frame], elapsed: float, scans: float) -> None:
        self._held += frames
        self._elapsed += elapsed
        self._scans += scans

    def _release(self) -> list[Frame]:
        held, self._held = self._held, []
        self._elapsed = self._scans = self._waited = 0.0
        return held
