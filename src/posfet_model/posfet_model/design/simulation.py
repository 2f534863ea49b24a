# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A follower run on a signal, and for how many samples and why the model is not valid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.amplifier.follower_base import Follower
from posfet_model.design.signal_file import Signal

PIECE: Final = 25_000
"""Samples that are computed at once, between two updates of the progress."""


@dataclass(frozen=True)
class Finding:
    """Reason why samples are not valid."""

    reason: str
    """The reason."""
    samples: int
    """Number of samples that it concerns."""
    first_time: float
    """Time of the first of them [s]."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Output of a follower on a signal."""

    v_out: Array
    """Output at each sample [V], shape [t]."""
    valid: Mask
    """Where the model is valid, shape [t]."""
    masks: dict[str, Mask]
    """Where each reason against it applies, shape [t]."""

    def findings(self, time: Array, rows: Mask) -> list[Finding]:
        """Return why samples are not valid, the reason of the earliest first; a sample may have several. Unchecked.

        Parameters
        ----------
        time : ndarray
            Time of each sample [s], shape [t].
        rows : ndarray
            Mask of the samples that count, shape [t].

        Returns
        -------
        list of Finding
            Reasons that apply to any of them.
        """
        found = []
        for reason, mask in self.masks.items():
            wrong = np.flatnonzero(mask & rows)
            if wrong.size:
                found.append(Finding(reason, int(wrong.size), float(time[wrong[0]])))
        return sorted(found, key=lambda one: one.first_time)


def simulate(follower: Follower, signal: Signal, progress: Callable[[int], None] = lambda done: None) -> Simulation:
    """Return the output of a follower that starts at rest.

    Parameters
    ----------
    follower : Follower
        The follower.
    signal : Signal
        Its input.
    progress : callable
        Called with the number of samples that are done.

    Returns
    -------
    Simulation
        Output, and where and why it is not valid.
    """
    steps = np.concatenate([[0.0], np.diff(signal.time)])  # the first step is none, at rest
    state = follower.start(signal.v_in[0])
    v_out, valid = np.empty(steps.size), np.empty(steps.size, np.bool_)
    masks: dict[str, Mask] = {}
    for begin in range(0, steps.size, PIECE):
        piece = slice(begin, begin + PIECE)
        series = follower.advance_series(state, signal.v_in[piece], steps[piece])
        state = series.end
        v_out[piece], valid[piece] = series.output.v_out, series.output.valid
        for reason, mask in (series.output.findings or {}).items():
            masks.setdefault(reason, np.zeros(steps.size, np.bool_))[piece] = mask
        progress(min(begin + PIECE, steps.size))
    return Simulation(v_out, valid, masks)
