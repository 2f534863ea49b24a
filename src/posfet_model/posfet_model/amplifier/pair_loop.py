# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A follower of two poles and a zero whose input stage is a square-law pair: rings, and slews.

The pair's current ``f(x)`` (`differential_pair.pair_current`), x the differential input in units of its overdrive Vov,
takes the place of x before the first pole:

    t1*dw/dt = A0*Vov*f((v_in - v_out)/Vov) - w,    t2*du/dt = w - u,    v_out = u + tz*du/dt

so the steepest slope is ``A0*Vov/t1``, and for small signals it is the op-amp of `open_loop`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model.amplifier.differential_pair import EDGE
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.amplifier.transient import Matrices

_LEAST_SECOND_TIME: Final = 1e-3
"""Time constant of a second pole that is at infinity, relative to that of the zero or of the follower [1]."""

_HALVINGS: Final = 60


@dataclass(frozen=True, eq=False)
class PairLoop:
    """The system that `transient` integrates, of the nodes w and u; unchecked."""

    open_loop: OpenLoop
    """The op-amp for small signals; numbers or arrays."""
    overdrive: Array
    """Vov of the pair at balance [V]."""

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Broadcast shape of the op-amp and the overdrive."""
        loop = self.open_loop
        return np.broadcast_shapes(*(np.shape(part) for part in (loop.gain, *loop.poles, loop.zero, self.overdrive)))

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array, Array]:
        """A0, t1 [s], t2 [s], tz/t2."""
        gain = np.asarray(self.open_loop.gain, np.float64)
        (t1, t2), tz = self.open_loop.pole_times, self.open_loop.zero_time
        t2 = np.maximum(t2, _LEAST_SECOND_TIME * np.maximum(np.abs(tz), t1 / (1 + gain)))
        return gain, t1, t2, tz / t2

    @cached_property
    def _capacitance(self) -> Array:
        matrix = np.zeros((*self.shape, 2, 2))
        matrix[..., 0, 0], matrix[..., 1, 1] = self._parts[1], self._parts[2]
        return matrix

    def output(self, nodes: Array) -> Array:
        """Return the output voltage [V] of the nodes' voltages; unchecked."""
        lead = self._parts[3]
        return np.asarray(lead * nodes[..., 0] + (1 - lead) * nodes[..., 1])

    def _pair(self, nodes: Array, v_in: Array) -> tuple[Array, Array]:
        """Return the pair's current in units of A0*Vov, and its slope."""
        x = np.clip((v_in - self.output(nodes)) / self.overdrive, -EDGE, EDGE)
        root = np.sqrt(1 - x * x / 4)
        return x * root, np.maximum(1 - x * x / 2, 0) / root

    def _driven(self, nodes: Array, current: Array) -> Array:
        first, second = nodes[..., 0], nodes[..., 1]
        return np.stack(np.broadcast_arrays(first - self._parts[0] * self.overdrive * current, second - first), axis=-1)

    def capacitances(self, nodes: Array, v_in: Array) -> tuple[Array, Array]:
        """Return the time constants as a matrix, and that of the input, which has none; unchecked."""
        shape = np.broadcast_shapes(nodes.shape[:-1], np.shape(v_in))
        return np.broadcast_to(self._capacitance, (*shape, 2, 2)), np.zeros((*shape, 2))

    def currents_and_capacitances(self, nodes: Array, v_in: Array) -> tuple[Array, Array, Array]:
        """Return what drives the nodes towards rest [V], and `capacitances`; unchecked."""
        return self._driven(nodes, self._pair(nodes, v_in)[0]), *self.capacitances(nodes, v_in)

    def evaluate(self, nodes: Array, v_in: Array) -> tuple[Array, Matrices]:
        """Return what drives the nodes towards rest [V], and the linearised system; unchecked."""
        current, slope = self._pair(nodes, v_in)
        gain, _, _, lead = self._parts
        drive = gain * slope
        matrix = np.empty((*drive.shape, 2, 2))
        matrix[..., 0, 0], matrix[..., 0, 1] = 1 + drive * lead, drive * (1 - lead)
        matrix[..., 1, 0], matrix[..., 1, 1] = -1.0, 1.0
        inputs = np.stack([-drive, np.zeros_like(drive)], axis=-1)
        return self._driven(nodes, current), Matrices(matrix, inputs, *self.capacitances(nodes, v_in))

    def operating_point(self, v_in: Array) -> Array:
        """Return the nodes at rest [V], by bisection; unchecked."""
        gain = self._parts[0]
        shape = np.broadcast_shapes(np.shape(v_in), self.shape)
        high = np.broadcast_to(np.abs(v_in), shape)
        low = -high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            x = np.clip((v_in - middle) / self.overdrive, -EDGE, EDGE)
            short = gain * self.overdrive * x * np.sqrt(1 - x * x / 4) > middle
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return np.stack([high, high], axis=-1)
