# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Faults of the communication link of a simulated board: one policy for scans and for CAN frames.

`LinkFaults` decides what happens to each transmission and when the board resets, and counts both. It is applied to
whole scans by `FaultyScans` and to CAN frames by `BusBoard`.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from enum import IntEnum
from typing import Final

import numpy as np

from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.random_streams import Stream, generator

_PAGE: Final = 1024
_HOUR: Final = 3600.0

RESETS: Final = "resets"
"""Counter of board resets."""
LOST_IN_RESETS: Final = "lost in resets"
"""Counter of scans that fall into the silence after a reset."""


class TransmissionOutcome(IntEnum):
    """What happens to one transmission: a whole scan, or one CAN frame that carries a scan."""

    DELIVERED = 0
    DROPPED = 1
    TRUNCATED = 2
    DUPLICATED = 3

    @property
    def counter(self) -> str:
        """Name of its counter."""
        return self.name.lower()


class LinkFaults:
    """Fault policy of one link: the outcome of each transmission, the resets of the board, and their counters.

    The outcome of transmission k depends on the seed and on k only, and the reset times on the seed only, whatever
    times are asked for. The board is switched on at time 0.

    Parameters
    ----------
    error_model : ErrorModel
        Probabilities of the outcomes [1], rate [1/h] and duration [s] of resets.
    seed : int
        Seed of the board.
    counters : dict of str to int, optional
        Counters of a previous run, to continue; by default all start at 0.
    """

    def __init__(self, error_model: ErrorModel, seed: int, counters: dict[str, int] | None = None) -> None:
        names = [outcome.counter for outcome in TransmissionOutcome if outcome]
        self.counters = dict.fromkeys([*names, LOST_IN_RESETS, RESETS], 0) if counters is None else counters
        """Number of transmissions by outcome other than delivered, of scans lost in resets, and of resets."""
        self.running_since = 0.0
        """Time [s] at which the board started to run after its last reset; in the silence of a reset, will start."""
        self._outcomes = _Outcomes(error_model, seed)
        self._schedule = ResetSchedule(error_model, seed)
        self.next_reset = self._schedule.next_after(0.0)
        """Time [s] of the next reset; infinite for never."""

    def outcome(self, number: int) -> TransmissionOutcome:
        """Return the outcome of transmission `number`, and count it."""
        outcome = self._outcomes.at(number)
        if outcome:
            self.counters[outcome.counter] += 1
        return outcome

    def reset_due(self, time: float) -> bool:
        """Return whether the board has reset by `time` [s], and count it; times ascend.

        Several resets since the last call count as one. `running_since` and `next_reset` are updated.

        Parameters
        ----------
        time : float
            Time since the board was switched on [s].
        """
        if time < self.next_reset:
            return False
        self.running_since = self._schedule.running_since(time)
        self.next_reset = self._schedule.next_after(time)
        self.counters[RESETS] += 1
        return True


class _Outcomes:
    """Random outcomes, drawn in pages."""

    def __init__(self, error_model: ErrorModel, seed: int) -> None:
        probabilities = (
            error_model.drop_probability,
            error_model.truncation_probability,
            error_model.duplication_probability,
        )
        self._cumulative = np.cumsum(probabilities)
        self._seed = seed
        self._page = -1
        self._outcomes: list[int] = []

    def at(self, number: int) -> TransmissionOutcome:
        """Return outcome `number`."""
        if not self._cumulative[-1]:
            return TransmissionOutcome.DELIVERED
        page, row = divmod(number, _PAGE)
        if page != self._page:
            draws = generator(self._seed, Stream.LINK, page).random(_PAGE)
            outcomes = np.searchsorted(self._cumulative, draws, side="right") + 1
            faulty = outcomes <= TransmissionOutcome.DUPLICATED
            self._outcomes = np.where(faulty, outcomes, TransmissionOutcome.DELIVERED).tolist()
            self._page = page
        return TransmissionOutcome(self._outcomes[row])


class ResetSchedule:
    """Random reset times of a board: a Poisson process of `resets_per_hour`, each reset followed by a silence."""

    def __init__(self, error_model: ErrorModel, seed: int) -> None:
        self._mean = _HOUR / error_model.resets_per_hour if error_model.resets_per_hour else math.inf
        self._silence = error_model.reset_time
        self._random = generator(seed, Stream.RESETS)
        self._times: list[float] = []
        self._next = self._draw(0.0)

    def _draw(self, since: float) -> float:
        return since + self._mean * float(self._random.exponential()) if math.isfinite(self._mean) else math.inf

    def running_since(self, time: float) -> float:
        """Return when the board that runs at `time` [s] started; in the silence of a reset, when it will start [s]."""
        while self._next <= time:
            self._times.append(self._next)
            self._next = self._draw(self._next + self._silence)
        count = bisect_right(self._times, time)
        return self._times[count - 1] + self._silence if count else 0.0

    def next_after(self, time: float) -> float:
        """Return the time of the first reset after `time` [s]; infinite for never."""
        self.running_since(time)
        count = bisect_right(self._times, time)
        return self._times[count] if count < len(self._times) else self._next
