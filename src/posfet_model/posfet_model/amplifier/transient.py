# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Transient of a system ``C(v)*dv/dt = -i(v, v_in)`` for a piecewise linear input, with an error bound for each step.

A linearly implicit method of order 3 with an embedded one of order 2, stiffly accurate and L-stable, whose order does
not depend on an exact Jacobian (the derivatives of C(v) are left out of it): ROS34PW2 of J. Rang, L. Angermann, BIT
Numerical Mathematics 45 (2005) 761, doi:10.1007/s10543-005-0035-y. Steps end at every given time, are cut where the
difference of the two orders exceeds the tolerance, and are of any length where the system follows its input.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from posfet_model._lib.types import Array

TOLERANCE: Final = 1e-5
"""Largest difference of the two orders in a step [V]; the error of the result is a small multiple of it."""

MOST_STEPS: Final = 20_000
"""Steps within one interval of the input, after which the system is taken for one that does not settle."""

_DIAGONAL: Final = 0.435866521508459
_ALPHA: Final = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.87173304301691801, 0.0, 0.0],
        [0.84457060015369423, -0.11299064236484185, 0.0],
        [0.0, 0.0, 1.0],
    ]
)
_GAMMA: Final = np.array(
    [
        [0.0, 0.0, 0.0],
        [-0.87173304301691801, 0.0, 0.0],
        [-0.90338057013044082, 0.054180672388095326, 0.0],
        [0.24212380706095346, -1.2232505839045147, 0.54526025533510214],
    ]
)
_ALPHA_SUMS: Final = [float(row.sum()) for row in _ALPHA]
_GAMMA_SUMS: Final = [float(row.sum()) for row in _GAMMA]
_WEIGHTS: Final = np.array([0.24212380706095346, -1.2232505839045147, 1.5452602553351020, 0.435866521508459])
_ERROR: Final = _WEIGHTS - np.array([0.37810903145819369, -0.096042292212423178, 0.5, 0.21793326075422950])

# Within a step: the weights at a share x of it are a cubic of x that meets the conditions of order 3, an identity at 1.
_FULL: Final = np.column_stack([_ALPHA + _GAMMA, np.zeros(4)]) + _DIAGONAL * np.eye(4)
_CONDITIONS: Final = np.stack([np.ones(4), _FULL.sum(axis=1), _ALPHA.sum(axis=1) ** 2, _FULL @ _FULL.sum(axis=1)])
_WITHIN: Final = np.linalg.solve(_CONDITIONS, np.array([[1, 0, 0], [0, 1 / 2, 0], [0, 0, 1 / 3], [0, 0, 1 / 6]]))

_GROWTH: Final = (0.2, 6.0)
"""Least and most change of the length from step to step [1]."""


@dataclass(frozen=True, eq=False)
class Matrices:
    """Linearised system: ``C*dv/dt + G*v = -(c_in*dv_in/dt + g_in*v_in)`` for small changes."""

    conductance: Array
    """G [S], shape [..., n, n]."""
    input_conductance: Array
    """g_in [S], shape [..., n]."""
    capacitance: Array
    """C [F], shape [..., n, n]."""
    input_capacitance: Array
    """c_in [F], shape [..., n]."""


class System(Protocol):
    """What is integrated: n nodes with currents and capacitances, driven by an input; each of the shape [...]."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Broadcast shape of the systems."""

    def operating_point(self, v_in: Array) -> Array:
        """Return the nodes at rest [V], shape [..., n]."""

    def capacitances(self, nodes: Array, v_in: Array) -> tuple[Array, Array]:
        """Return C and c_in [F]."""

    def currents_and_capacitances(self, nodes: Array, v_in: Array) -> tuple[Array, Array, Array]:
        """Return i [A], shape [..., n], C and c_in [F]."""

    def evaluate(self, nodes: Array, v_in: Array) -> tuple[Array, Matrices]:
        """Return i [A] and the linearised system."""

    def output(self, nodes: Array) -> Array:
        """Return the output voltage [V], shape [...]."""


@dataclass(frozen=True, eq=False)
class SystemState:
    """State of systems between steps."""

    v_in: Array
    """Input voltage [V], shape [...]."""
    nodes: Array
    """Voltages of the unknown nodes [V], shape [..., n]."""
    step: float
    """Length of step that the error bound allowed last [s]."""


def advance(
    system: System, state: SystemState, v_in: Array, duration: float, tolerance: float, share: float = 0.0
) -> SystemState:
    """Return the state after an interval in which the input changed linearly; a duration of 0 is a jump. Unchecked.

    Parameters
    ----------
    system : System
        The systems.
    state : SystemState
        State at the start.
    v_in : ndarray
        Input at the end [V], shape [...].
    duration : float
        Length of the interval [s].
    tolerance : float
        Largest difference of the two orders in a step [V].
    share : float, default 0.0
        The same in addition, as a share of the largest change of a node in the step [1].

    Returns
    -------
    SystemState
        State at the end.
    """
    if duration == 0:
        return SystemState(v_in, _jump(system, state, v_in), state.step)
    return advance_through(system, state, v_in, np.array([duration]), tolerance, share)[0]


def advance_through(
    system: System, state: SystemState, v_in: Array, times: Array, tolerance: float, share: float = 0.0
) -> tuple[SystemState, Array]:
    """Return the state after an interval in which the input changed linearly, and the nodes within it. Unchecked.

    Parameters
    ----------
    system : System
        The systems.
    state : SystemState
        State at the start.
    v_in : ndarray
        Input at the end [V], shape [...].
    times : ndarray
        Instants within the interval [s] from its start, shape [t], increasing from above 0; the last one is its end.
    tolerance : float
        Largest difference of the two orders in a step [V].
    share : float, default 0.0
        The same in addition, as a share of the largest change of a node in the step [1].

    Returns
    -------
    tuple
        State at the end, and voltages of the nodes at the instants [V], shape [t, ..., n].
    """
    return _through(system, state, v_in, times[-1], times / times[-1], tolerance, share)


def advance_together(
    system: System, state: SystemState, v_in: Array, durations: Array, tolerance: float
) -> tuple[SystemState, Array]:
    """Return the state after an interval that is of another length for each system, and the nodes then. Unchecked.

    Parameters
    ----------
    system : System
        The systems.
    state : SystemState
        State at the start.
    v_in : ndarray
        Input at the end [V], shape [...].
    durations : ndarray
        Length of the interval [s], shape [...]; 0 is a jump.
    tolerance : float
        Largest difference of the two orders in a step [V].

    Returns
    -------
    tuple
        State at the end, and voltages of the nodes then [V], shape [..., n].
    """
    jumps = durations == 0
    if jumps.any():
        jumped = np.where(jumps, v_in, state.v_in)
        state = SystemState(jumped, np.where(jumps[..., None], _jump(system, state, jumped), state.nodes), state.step)
    if not jumps.all():
        state, _ = _through(system, state, v_in, durations, np.ones(1), tolerance)
    return state, state.nodes


def _through(
    system: System,
    state: SystemState,
    v_in: Array,
    duration: Array,
    shares: Array,
    tolerance: float,
    relative: float = 0.0,
) -> tuple[SystemState, Array]:
    """Return the state after an interval of the durations [s], and the nodes at shares of it, the last of which is 1.

    All systems take the same steps in units of their durations.
    """
    longest = float(np.max(duration))
    slope = (v_in - state.v_in) / np.where(duration > 0, duration, 1.0)
    nodes, done, step = state.nodes, 0.0, state.step / longest
    found = np.full((shares.size, *nodes.shape), np.nan)
    if not np.isfinite(nodes).all():
        return SystemState(v_in, found[-1], state.step), found
    for _ in range(MOST_STEPS):
        left = 1.0 - done
        share = left if step >= left * (1 - 1e-9) else min(step, 0.5 * left) if step > 0.5 * left else step
        start = state.v_in + slope * (done * duration)
        moved, error, changes = _step(system, nodes, start, slope, share * duration)
        allowed = tolerance + relative * float(np.max(np.abs(moved - nodes))) if relative else tolerance
        ratio = error / allowed
        factor = float(np.clip(0.9 / max(ratio, 1e-9) ** (1 / 3), *_GROWTH)) if np.isfinite(ratio) else _GROWTH[0]
        if ratio <= 1:
            inside = slice(*np.searchsorted(shares, [done, done + share], side="right"))
            if inside.stop > inside.start:
                within = (shares[inside] - done) / share
                found[inside] = nodes + np.tensordot(within[:, None] ** (1, 2, 3) @ _WITHIN.T, changes, 1)
            nodes, done = moved, done + share
            # A step cut short by the end of the interval says nothing against the longer one before it.
            step = max(share * factor, step) if share < step else share * factor
            if share == left:
                found[-1] = nodes
                return SystemState(v_in, nodes, step * longest), found
        else:
            step = share * min(factor, 0.9)
    found[-1] = np.nan
    return SystemState(v_in, found[-1], step * longest), found


def _step(system: System, nodes: Array, v_in: Array, slope: Array, length: Array) -> tuple[Array, float, Array]:
    """Return the voltages after one step, the largest difference of the two orders [V], and the stages' changes [V]."""
    current, linear = system.evaluate(nodes, v_in)
    capacitance, column = linear.capacitance, linear.input_capacitance
    each = np.asarray(length)[..., None]
    matrix = np.linalg.inv(capacitance + (_DIAGONAL * each[..., None]) * linear.conductance)
    changes: list[Array] = []  # of each stage: rate times length
    for stage in range(4):
        if stage:
            place = nodes + sum(a * change for a, change in zip(_ALPHA[stage], changes, strict=False) if a)
            at = v_in + length * slope * _ALPHA_SUMS[stage]
            current, here, here_column = system.currents_and_capacitances(place, at)
            free = np.linalg.solve(here, -(current + here_column * slope[..., None])[..., None])
        else:
            free = np.linalg.solve(capacitance, -(current + column * slope[..., None])[..., None])
        right = (capacitance @ free)[..., 0]
        drift = length * slope * (_GAMMA_SUMS[stage] + _DIAGONAL)
        right = right - linear.input_conductance * drift[..., None]
        if stage:
            held = sum(g * change for g, change in zip(_GAMMA[stage], changes, strict=False) if g)
            right = right - (linear.conductance @ np.asarray(held)[..., None])[..., 0]
        changes.append(each * (matrix @ right[..., None])[..., 0])
    stacked = np.stack(changes)
    moved = nodes + np.tensordot(_WEIGHTS, stacked, 1)
    return moved, float(np.max(np.abs(np.tensordot(_ERROR, stacked, 1)))), stacked


def _jump(system: System, state: SystemState, v_in: Array) -> Array:
    """Return the voltages after a jump of the input, which the capacitances divide."""
    capacitance, column = system.capacitances(state.nodes, state.v_in)
    change = column * (v_in - state.v_in)[..., None]
    return np.asarray(state.nodes - np.linalg.solve(capacitance, change[..., None])[..., 0])
