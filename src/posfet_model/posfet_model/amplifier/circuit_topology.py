# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which nodes the op-amps have, what is between them, and the matrices that follow: one stage and two."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array

NAMES: Final = ("M1", "M2", "M3", "M4", "M5", "M6", "M7", "M8")

UNKNOWNS: Final = {2: ("mirror", "first", "tail", "out", "zero"), 1: ("mirror", "first", "tail", "out")}
"""Nodes whose voltages are computed, by the number of stages."""

_KNOWN: Final = ("in", "vdd", "vss", "bias", "ground")

_SHARED: Final = ("mirror mirror vdd", "first mirror vdd", "tail bias vss", "bias bias vss")

_TRANSISTORS: Final = {
    2: ("mirror inverting tail", "first in tail", *_SHARED, "out first vdd", "out bias vss"),
    1: ("mirror in tail", "first inverting tail", *_SHARED, "vdd first out", "out bias vss"),
}
"""Drain, gate and source of M1 to M8, by the number of stages."""

POLARITY: Final = {2: (1, 1, -1, -1, 1, 1, -1, 1), 1: (1, 1, -1, -1, 1, 1, 1, 1)}


def couple(matrix: Array, one: int, other: int, value: Array) -> None:
    """Add an element of a value between two nodes to a matrix, in place; unchecked."""
    matrix[..., one, one] += value
    matrix[..., other, other] += value
    matrix[..., one, other] -= value
    matrix[..., other, one] -= value


def assemble(scatter: Array, first: Array, second: Array) -> Array:
    """Return the matrix [..., n, n + 1] of unknown nodes and input, from two numbers for each transistor."""
    flat = np.concatenate(np.broadcast_arrays(first, second), axis=-1) @ scatter.reshape(len(scatter), -1)
    return np.asarray(flat.reshape(*flat.shape[:-1], *scatter.shape[1:]))


def _index(stages: int, inverting: str = "out") -> list[list[int]]:
    """Return drain, gate and source of M1 to M8 as indices of the nodes: the unknown, then the known ones."""
    nodes = (*UNKNOWNS[stages], *_KNOWN)
    names = [transistor.replace("inverting", inverting).split() for transistor in _TRANSISTORS[stages]]
    return [list(column) for column in zip(*([nodes.index(name) for name in row] for row in names), strict=True)]


def _scatter(stages: int, inverting: str, *pairs: tuple[tuple[int, int], tuple[int, int]]) -> Array:
    """Return a map [8*len(pairs), n, n + 1] from the transistors' numbers to a matrix of node currents.

    Each pair has the terminals between which a current flows, and those whose voltage controls it.
    """
    n = len(UNKNOWNS[stages])
    scatter = np.zeros((8 * len(pairs), n, n + 1))
    index = _index(stages, inverting)
    for block, (ends, controls) in enumerate(pairs):
        for m in range(8):
            for end, sign in zip(ends, (1, -1), strict=True):
                for terminal, weight in zip(controls, (1, -1), strict=True):
                    row, column = index[end][m], index[terminal][m]
                    if row < n and column <= n:
                        scatter[8 * block + m, row, column] += sign * weight
    return scatter


_D, _G, _S = 0, 1, 2
SIGNS: Final = {stages: np.array(signs, np.float64) for stages, signs in POLARITY.items()}
TERMINALS: Final = {stages: [np.array(part) for part in _index(stages)] for stages in UNKNOWNS}
CONDUCTANCE_MAP: Final = {
    (stages, node): _scatter(stages, node, ((_D, _S), (_G, _S)), ((_D, _S), (_D, _S)))
    for stages in UNKNOWNS
    for node in ("out", "ground")
}
CAPACITANCE_MAP: Final = {
    (stages, node): _scatter(stages, node, ((_G, _S), (_G, _S)), ((_G, _D), (_G, _D)))
    for stages in UNKNOWNS
    for node in ("out", "ground")
}
INCIDENCE: Final = {
    stages: np.array([(drain == n) * 1.0 - (source == n) for n in range(len(UNKNOWNS[stages]))]).T
    for stages, (drain, _, source) in TERMINALS.items()
}
