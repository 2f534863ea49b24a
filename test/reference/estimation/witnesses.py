# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the temperature sensors alone say since some seconds ago."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from posfet_core.scan_path import Belief, ForceErrorFilter

if TYPE_CHECKING:
    from reference.estimation.force_estimator import Block

Array = NDArray[np.float64]

SPACING: Final = 2.0
"""Time between two witnesses [s], assumed."""

COUNT: Final = 5
"""Number of witnesses."""

PASSAGE: Final = 0.09
"""Least duration of a passage [s]."""

LEAST_LEFT: Final = 1e-9
"""Least share of its warmth that a taxel keeps in a block [1]."""


@dataclass
class Witness:
    """A belief of some time ago, and one that follows from it by the temperature sensors alone."""

    before: Belief
    """What was known then."""
    filter: ForceErrorFilter
    """What follows from it; only its shared states are used."""
    age: float = 0.0
    """How long ago that was [s]."""
    evidence: float = 0.0
    """Twice the logarithm of how much likelier readings are without zeros than with [1]."""
    followed: int = 0
    """Number of passages since then that `filter` has followed."""


class Witnesses:
    """Witnesses of the last seconds, oldest first. What passes between two readings of the sensors is a passage.

    Of readings that follow each other faster, those in between are left out. In each block one witness follows one
    passage.
    """

    def __init__(self) -> None:
        self.all: list[Witness] = []
        self._blocks: list[list[list[Block]]] = []  # of each witness, of each passage

    def clear(self) -> None:
        """Forget all."""
        self.all, self._blocks = [], []

    def add(self, block: Block) -> None:
        """Record a block."""
        for witness, passages in zip(self.all, self._blocks, strict=True):
            witness.age += block.span
            passages[-1].append(replace(block, own_noise=block.own_noise.copy()))
        begun = sum(each.span for each in self._blocks[-1][-1]) if self.all else 0.0
        if not math.isnan(block.reading) and begun >= PASSAGE:
            for passages in self._blocks:
                passages.append([])

    def behind(self) -> tuple[Witness, Block] | None:
        """Return the first witness that has not followed all passages, and what has passed; it follows that now."""
        for witness, passages in zip(self.all, self._blocks, strict=True):
            if witness.followed < len(passages) - 1:
                witness.followed += 1
                return witness, _passage(passages[witness.followed - 1])
        return None

    def call(self, belief: Belief) -> None:
        """Call a witness of a belief, if the last one is old enough and no passage has begun."""
        if self.all and (self.all[-1].age < SPACING or self._blocks[-1][-1]):
            return
        if len(self.all) == COUNT:
            del self.all[0], self._blocks[0]
        self.all.append(Witness(belief.copy(), ForceErrorFilter(belief.copy())))
        self._blocks.append([[]])

    def passages(self, witness: Witness) -> Iterator[Block]:
        """Yield what has passed since a witness was called, with equal parts of the process noise of the taxels.

        The last part is what no reading has ended yet.
        """
        passages = self._blocks[[each is witness for each in self.all].index(True)]
        all_blocks = [block for passage in passages for block in passage]
        noise = np.sum([block.own_noise for block in all_blocks], axis=0)
        left = np.sum([np.log(np.maximum(1.0 - block.cooled, LEAST_LEFT)) for block in all_blocks], axis=0)
        parts = [_passage(passage) for passage in passages if passage]
        if passages[-1]:
            parts[-1].reading = math.nan
        for part in parts:
            yield replace(part, own_noise=noise / len(parts), cooled=-np.expm1(left / len(parts)))


def _passage(blocks: list[Block]) -> Block:
    """Return what has passed in some blocks, in which nothing touched."""
    last = blocks[-1]
    span = sum(block.span for block in blocks)
    nothing = np.zeros_like(last.mean)
    return replace(
        last,
        span=span,
        leak=sum(block.span * block.leak for block in blocks) / span,
        warming=sum(block.span * block.warming for block in blocks) / span,
        rate_noise=sum(block.rate_noise for block in blocks),
        leak_noise=sum(block.leak_noise for block in blocks),
        moved_share=0.0,
        tail_moved=0.0,
        touched=np.zeros_like(last.touched),
        neighbour=nothing,
        tail=nothing,
        own_noise=np.zeros_like(last.own_noise),
        cooled=nothing,
    )
