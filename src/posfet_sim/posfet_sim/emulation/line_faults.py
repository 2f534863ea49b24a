"""What goes wrong between a simulated board and whoever listens: scans lost, torn, repeated, and boards that reset."""

from __future__ import annotations

import math
from bisect import bisect_right
from enum import IntEnum
from typing import Final

import numpy as np

from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.device.random_streams import Stream, generator
from posfet_sim.device.simulated_board import SimulatedBoard

_PAGE: Final = 1024
_HOUR: Final = 3600.0


class Fate(IntEnum):
    """What becomes of a scan, or of a frame."""

    WHOLE = 0
    DROPPED = 1
    TORN = 2
    REPEATED = 3


class Fates:
    """Draws fates; fate k depends on the seed and on k alone."""

    def __init__(self, imperfections: Imperfections, seed: int) -> None:
        shares = (imperfections.dropped_share, imperfections.torn_share, imperfections.repeated_share)
        self._ends = np.cumsum(shares)
        self._seed = seed
        self._page = -1
        self._fates: list[int] = []

    def at(self, number: int) -> int:
        """Return fate `number`, one of Fate."""
        if not self._ends[-1]:
            return Fate.WHOLE
        page, row = divmod(number, _PAGE)
        if page != self._page:
            chances = generator(self._seed, Stream.LINE, page).random(_PAGE)
            fates = np.searchsorted(self._ends, chances, side="right") + 1
            self._fates = np.where(fates > Fate.REPEATED, Fate.WHOLE, fates).tolist()
            self._page = page
        return self._fates[row]


class Resets:
    """When a board resets: at random, on average `resets_per_hour` times an hour, each time silent for a while."""

    def __init__(self, imperfections: Imperfections, seed: int) -> None:
        self._mean = _HOUR / imperfections.resets_per_hour if imperfections.resets_per_hour else math.inf
        self._silence = imperfections.reset_time
        self._random = generator(seed, Stream.RESETS)
        self._times: list[float] = []
        self._next = self._draw(0.0)

    def _draw(self, since: float) -> float:
        return since + self._mean * float(self._random.exponential()) if math.isfinite(self._mean) else math.inf

    def alive_since(self, time: float) -> float:
        """Return when the board began to run that runs at `time` [s]; in the silence of a reset, when it will."""
        while self._next <= time:
            self._times.append(self._next)
            self._next = self._draw(self._next + self._silence)
        count = bisect_right(self._times, time)
        return self._times[count - 1] + self._silence if count else 0.0

    def next_after(self, time: float) -> float:
        """Return when the board resets next after a time [s] that `alive_since` was asked for; infinite for never."""
        self.alive_since(time)
        count = bisect_right(self._times, time)
        return self._times[count] if count < len(self._times) else self._next


class FaultyScans:
    """The scans of a board as a driver would hand them on behind a faulty line: missing, or twice.

    A torn scan is missing, too: a driver never hands on a part. After a reset number and clock of the scans begin anew
    and the first has its flag.
    """

    def __init__(self, board: SimulatedBoard, seed: int) -> None:
        """Take the board, and the seed that its imperfections are drawn from."""
        self.board = board
        self.counters = {fate.name.lower(): 0 for fate in Fate if fate} | {"silent": 0, "resets": 0}
        """Scans by what became of them, those that fell into the silence of a reset, and resets."""
        self._fates = Fates(board.imperfections, seed)
        self._resets = Resets(board.imperfections, seed)
        self._origin = 0  # index of the first scan since the last reset
        self._alive_since = 0.0
        self._reset = False

    def scan(self, index: int, out: Scan) -> int:
        """Take scan number `index` of the board; return how many times it is handed on: 0, 1, or 2.

        With 0 `out` is left alone. Indices ascend, as for the board.
        """
        time = self.board.clock.time(index)
        alive_since = self._resets.alive_since(time)
        if alive_since != self._alive_since:
            self.counters["resets"] += 1
            self._alive_since = alive_since
            self._origin = -1
        if time < alive_since:
            self.counters["silent"] += 1
            return 0
        if self._origin < 0:
            self._origin, self._reset = index, True
        fate = self._fates.at(index)
        if fate:
            self.counters[Fate(fate).name.lower()] += 1
        if fate in {Fate.DROPPED, Fate.TORN}:
            return 0
        self.board.scan(index, out)
        if self._origin:
            out.sequence -= self._origin
            out.device_time -= round(self._origin / self.board.sensor.can.scan_rate * 1e6)
        if self._reset:
            out.status |= ScanStatus.BOARD_RESET
            self._reset = False
        return 2 if fate == Fate.REPEATED else 1
