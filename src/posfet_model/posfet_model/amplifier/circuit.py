# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The op-amps as circuits of square-law transistors: node currents, capacitances, operating point, small signals.

    M1, M2   POSFET input pair              M5, M6, M8  n-channel current mirror fed by the reference current
    M3, M4   p-channel mirror load          M7          two stages: p-channel, Cc and Rz from gate to drain
                                                        one stage: n-channel output follower, Cc from gate to ground

The unknowns are the node voltages mirror, first (gate of M7), tail, out, and zero (between Rz and Cc) with two stages;
Kirchhoff's current law makes ``C(v)*dv/dt = -i(v, v_in)`` of them. Nothing is fitted: a zero, a mirror pole, the
feed-through of the tail's capacitance, currents that M8 cannot sink and transistors out of saturation are in it.
Transistors: `square_law`. All numbers may be arrays, which broadcast: thousands of circuits at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model._lib.validation import instance, whole_number
from posfet_model.amplifier.circuit_topology import (
    CAPACITANCE_MAP,
    CONDUCTANCE_MAP,
    INCIDENCE,
    NAMES,
    POLARITY,
    SIGNS,
    TERMINALS,
    UNKNOWNS,
    assemble,
    couple,
)
from posfet_model.amplifier.operating_point import CIRCUIT_B, TABLE_II, AmplifierBias, AmplifierDesign
from posfet_model.amplifier.square_law import Linearised, gate_capacitances, linearise, saturated
from posfet_model.amplifier.transient import Matrices
from posfet_model.device.transistor import Plane

_SCALARS: Final = (
    "modulation",
    "supply",
    "reference_current",
    "compensation",
    "zero_resistor",
    "load_resistance",
    "load_capacitance",
)
"""Fields of a bias that a circuit takes over."""

_LEAST_RESISTANCE: Final = 0.1
"""Rz in place of none [ohm]: with any Cc far beyond all other poles, yet no stiffer than rounding bears."""

_LEAST_CONDUCTANCE: Final = 1e-12
"""From each node to ground, so that transistors in cut-off leave no node floating [S]."""

_LEAST_CAPACITANCE: Final = 1e-18
"""From each node to ground, so that an output without load is no singular case [F]."""

_MOST_CHANGE: Final = 0.5
"""Largest change of a node in an iteration of the operating point [V]."""

_DECAYED: Final = 30.0
"""Duration, in the slowest time constant, after which a transient of a volt is no longer seen."""

_LEAST_LAG: Final = 1e-3
"""Lag of a node [V] below which the square of it, in volts, does not matter."""

_ITERATIONS: Final = 200
_TOLERANCE: Final = 1e-13
_LAST_CHANGE: Final = 1e-8
"""Largest last change of Newton's method, of the supply; the error that it leaves is of its square."""


@dataclass(frozen=True, eq=False)
class AmplifierCircuit:
    """Follower as a circuit; each number may be an array. Fields are unchecked: use `from_design`."""

    stages: int
    """2 or 1."""
    beta: Array
    """Gain factors of M1 to M8 [A/V2], shape [..., 8]."""
    gate_area: Array
    """W*L*Cox of M1 to M8 [F], shape [..., 8]."""
    threshold: Array
    """Magnitudes of the thresholds of M1 to M8 [V], shape [..., 8]."""
    modulation: Array
    """lambda [1/V]."""
    supply: Array
    """Positive supply and magnitude of the negative one [V]."""
    reference_current: Array
    """Current into M6 [A]."""
    compensation: Array
    """Cc [F]."""
    zero_resistor: Array
    """Rz [ohm]."""
    load_resistance: Array
    """From the output to ground [ohm]."""
    load_capacitance: Array
    """From the output to ground [F]."""

    @classmethod
    def from_design(
        cls, bias: AmplifierBias = CIRCUIT_B, design: AmplifierDesign = TABLE_II, stages: int = 2
    ) -> AmplifierCircuit:
        """Return the circuit of a bias, of sizes and process, and of a number of stages.

        Parameters
        ----------
        bias : AmplifierBias, default CIRCUIT_B
            Bias, compensation and load.
        design : AmplifierDesign, default TABLE_II
            Sizes and process.
        stages : int, default 2
            2: Miller op-amp (`two_stage`); 1: one stage and an output follower (`one_stage`).

        Returns
        -------
        AmplifierCircuit
            The circuit.

        Raises
        ------
        ValueError
            `stages` is neither 1 nor 2, or an argument is of another type.
        """
        bias, design = instance("bias", bias, AmplifierBias), instance("design", design, AmplifierDesign)
        stages = whole_number("stages", stages, 1, 2)
        mobility = [design.electron_mobility if polarity > 0 else design.hole_mobility for polarity in POLARITY[stages]]
        plane = [design.stack.drive(Plane.GATE) if name in ("M1", "M2") else design.stack.oxide for name in NAMES]
        shift = [design.pair_threshold_shift if name in ("M1", "M2") else 0.0 for name in NAMES]
        sizes = [design.size(name) for name in NAMES]
        return cls(
            stages=stages,
            beta=np.array(mobility) * plane * np.array([size.width / size.length for size in sizes]),
            gate_area=np.array(plane) * [size.width * size.length for size in sizes],
            threshold=bias.threshold + np.array(shift),
            **{name: np.asarray(getattr(bias, name), np.float64) for name in _SCALARS},
        )

    @classmethod
    def stack(cls, circuits: Sequence[AmplifierCircuit]) -> AmplifierCircuit:
        """Return many circuits of the same number of stages as one of arrays; unchecked."""
        names = [name for name in cls.__dataclass_fields__ if name != "stages"]
        columns = {name: np.stack([np.asarray(getattr(one, name)) for one in circuits]) for name in names}
        return cls(stages=circuits[0].stages, **columns)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Broadcast shape of the circuits."""
        scalars = (np.shape(getattr(self, name)) for name in _SCALARS)
        eights = (np.shape(part)[:-1] for part in (self.beta, self.gate_area, self.threshold))
        return np.broadcast_shapes(*scalars, *eights)

    @property
    def polarity(self) -> Array:
        """1 for n-channel, -1 for p-channel transistors, of M1 to M8."""
        return SIGNS[self.stages]

    @cached_property
    def _known(self) -> Array:
        """Voltages of supplies, gate bias and ground [V], shape [..., 4]."""
        lam, vth = np.asarray(self.modulation), self.threshold[..., 5]
        overdrive = np.sqrt(2 * self.reference_current / self.beta[..., 5])
        for _ in range(_ITERATIONS):
            factor = 1 + lam * (vth + overdrive)
            value = 0.5 * self.beta[..., 5] * overdrive**2 * factor - self.reference_current
            slope = self.beta[..., 5] * overdrive * factor + 0.5 * self.beta[..., 5] * overdrive**2 * lam
            change = value / slope
            overdrive = overdrive - change
            if np.all(np.abs(change) <= _TOLERANCE):
                break
        bias = -self.supply + vth + overdrive
        parts = np.broadcast_arrays(self.supply, -self.supply, bias, 0.0)
        return np.broadcast_to(np.stack(parts, axis=-1), (*self.shape, 4))

    @cached_property
    def _linear(self) -> tuple[Array, Array]:
        """Conductances and capacitances of resistors and capacitors, shape [..., n, n]."""
        nodes = UNKNOWNS[self.stages]
        conductance = np.zeros((*self.shape, len(nodes), len(nodes)))
        capacitance = np.zeros_like(conductance)
        first, out = nodes.index("first"), nodes.index("out")
        conductance[..., range(len(nodes)), range(len(nodes))] = _LEAST_CONDUCTANCE
        capacitance[..., range(len(nodes)), range(len(nodes))] = _LEAST_CAPACITANCE
        conductance[..., out, out] += 1 / self.load_resistance
        capacitance[..., out, out] += self.load_capacitance
        if self.stages == 1:
            capacitance[..., first, first] += self.compensation
            return conductance, capacitance
        zero = nodes.index("zero")
        couple(conductance, first, zero, 1 / np.maximum(self.zero_resistor, _LEAST_RESISTANCE))
        couple(capacitance, zero, out, self.compensation)
        return conductance, capacitance

    def _voltages(self, nodes: Array, v_in: Array) -> tuple[Array, Array]:
        """Return gate-source and drain-source voltages of M1 to M8 [V], shape [..., 8]."""
        known = np.broadcast_to(self._known, (*nodes.shape[:-1], 4))
        everything = np.concatenate([nodes, np.asarray(v_in)[..., None], known], axis=-1)
        drain, gate, source = (everything[..., index] for index in TERMINALS[self.stages])
        return gate - source, drain - source

    def transistors(self, nodes: Array, v_in: Array) -> tuple[Array, Array, Linearised]:
        """Return gate-source and drain-source voltages [V], currents and conductances of M1 to M8; unchecked.

        Parameters
        ----------
        nodes : ndarray
            Voltages of the unknown nodes [V], shape [..., n].
        v_in : ndarray
            Input voltage [V], shape [...].

        Returns
        -------
        tuple
            Gate-source and drain-source voltages, and the transistors, each of shape [..., 8].
        """
        gate, drain = self._voltages(nodes, v_in)
        polarity = SIGNS[self.stages]
        lam = np.asarray(self.modulation)[..., None]
        return gate, drain, linearise(polarity, self.beta, self.threshold, lam, gate, drain)

    def currents(self, nodes: Array, v_in: Array) -> Array:
        """Return the currents that leave each unknown node through resistors and transistors [A]; unchecked.

        Parameters
        ----------
        nodes : ndarray
            Voltages of the unknown nodes [V], shape [..., n].
        v_in : ndarray
            Input voltage [V], shape [...].

        Returns
        -------
        ndarray
            Currents [A], shape [..., n].
        """
        return self._sum(nodes, self.transistors(nodes, v_in)[2].current)

    def _sum(self, nodes: Array, current: Array) -> Array:
        return np.asarray(current @ INCIDENCE[self.stages] + (self._linear[0] @ nodes[..., None])[..., 0])

    def capacitances(self, nodes: Array, v_in: Array) -> tuple[Array, Array]:
        """Return the capacitance matrix of the unknown nodes and its column of the input [F]; unchecked.

        Parameters
        ----------
        nodes : ndarray
            Voltages of the unknown nodes [V], shape [..., n].
        v_in : ndarray
            Input voltage [V], shape [...].

        Returns
        -------
        tuple of ndarray
            C of shape [..., n, n], c_in of shape [..., n].
        """
        return self._capacitances(*self._voltages(nodes, v_in))

    def currents_and_capacitances(self, nodes: Array, v_in: Array) -> tuple[Array, Array, Array]:
        """Return what `currents` and `capacitances` return, of one look at the transistors; unchecked."""
        gate, drain, parts = self.transistors(nodes, v_in)
        return self._sum(nodes, parts.current), *self._capacitances(gate, drain)

    def _capacitances(self, gate: Array, drain: Array, inverting: str = "out") -> tuple[Array, Array]:
        parts = gate_capacitances(SIGNS[self.stages], self.gate_area, self.threshold, gate, drain)
        matrix = assemble(CAPACITANCE_MAP[self.stages, inverting], *parts)
        n = matrix.shape[-2]
        return matrix[..., :n] + self._linear[1], matrix[..., n]

    def evaluate(self, nodes: Array, v_in: Array, inverting: str = "out") -> tuple[Array, Matrices]:
        """Return the currents that leave each node [A], and the circuit linearised there; unchecked.

        Parameters
        ----------
        nodes : ndarray
            Voltages of the unknown nodes [V], shape [..., n].
        v_in : ndarray
            Input voltage [V], shape [...].
        inverting : {"out", "ground"}
            What the inverting input follows in small signals: the output, or nothing, which opens the loop.

        Returns
        -------
        tuple
            Currents of shape [..., n], and matrices.
        """
        gate, drain, parts = self.transistors(nodes, v_in)
        linear = Matrices(*self._conductance(parts, inverting), *self._capacitances(gate, drain, inverting))
        return self._sum(nodes, parts.current), linear

    def _conductance(self, parts: Linearised, inverting: str = "out") -> tuple[Array, Array]:
        matrix = assemble(CONDUCTANCE_MAP[self.stages, inverting], parts.transconductance, parts.output_conductance)
        n = matrix.shape[-2]
        return matrix[..., :n] + self._linear[0], matrix[..., n]

    def operating_point(
        self, v_in: Array | float = 0.0, guess: Array | None = None, last_change: float = _LAST_CHANGE
    ) -> Array:
        """Return the voltages of the unknown nodes at rest, by Newton's method with limited changes; unchecked.

        Parameters
        ----------
        v_in : ndarray or float, default 0.0
            Input voltage [V]; broadcasts with the circuits.
        guess : ndarray, optional
            Voltages to start from [V], shape [..., n]; where they are NaN, and without them, those of `start`.
        last_change : float, optional
            Largest change in the last iteration, of the supply; the error is of its square.

        Returns
        -------
        ndarray
            Voltages [V], shape [..., n]; NaN where there is no solution between the supplies.
        """
        shape = np.broadcast_shapes(np.shape(v_in), self.shape)
        v_in = np.broadcast_to(np.asarray(v_in, np.float64), shape)
        nodes = self.start(v_in)
        if guess is not None:
            nodes = np.where(np.isfinite(guess).all(axis=-1, keepdims=True), guess, nodes)
        limit = np.broadcast_to(self.supply, shape)[..., None]
        for _ in range(_ITERATIONS):
            parts = self.transistors(nodes, v_in)[2]
            change = np.linalg.solve(self._conductance(parts)[0], self._sum(nodes, parts.current)[..., None])[..., 0]
            largest = np.max(np.abs(change), axis=-1, keepdims=True)
            nodes = np.clip(nodes - change * np.minimum(1, _MOST_CHANGE / np.maximum(largest, 1e-300)), -limit, limit)
            if np.all(largest <= last_change * limit):
                break
        return np.where(largest <= last_change * limit, nodes, np.nan)

    def start(self, v_in: Array) -> Array:
        """Return a guess of the operating point, for `operating_point` to start from; unchecked.

        Parameters
        ----------
        v_in : ndarray
            Input voltage [V], of the broadcast shape.

        Returns
        -------
        ndarray
            Voltages [V], shape [..., n].
        """
        guess = {
            "tail": v_in - self.threshold[..., 0] - 0.4,
            "mirror": self.supply - self.threshold[..., 2] - 0.4,
            "out": v_in,
        }
        guess["first"] = guess["mirror"] if self.stages == 2 else v_in + self.threshold[..., 6] + 0.4
        guess["zero"] = guess["first"]
        return np.stack([np.broadcast_to(guess[name], v_in.shape) for name in UNKNOWNS[self.stages]], axis=-1)

    def output(self, nodes: Array) -> Array:
        """Return the output voltage [V], shape [...], of the nodes' voltages; unchecked."""
        return np.asarray(nodes[..., UNKNOWNS[self.stages].index("out")])

    def saturated(self, nodes: Array, v_in: Array) -> Mask:
        """Return which of M1 to M8 conduct in saturation; unchecked.

        Parameters
        ----------
        nodes : ndarray
            Voltages of the unknown nodes [V], shape [..., n].
        v_in : ndarray
            Input voltage [V], shape [...].

        Returns
        -------
        ndarray
            Mask, shape [..., 8].
        """
        return saturated(SIGNS[self.stages], self.threshold, *self._voltages(nodes, v_in))

    def stable(self, nodes: Array, v_in: Array) -> Mask:
        """Return whether the follower is stable in small signals at these nodes; unchecked.

        Parameters
        ----------
        nodes : ndarray
            Voltages of the unknown nodes [V], shape [..., n].
        v_in : ndarray
            Input voltage [V], shape [...].

        Returns
        -------
        ndarray
            Mask, shape [...]; False where a node is NaN.
        """
        found: Mask = np.asarray(np.isfinite(nodes).all(axis=-1))
        linear = self.evaluate(np.where(found[..., None], nodes, self.start(v_in)), v_in)[1]
        rates = np.linalg.eigvals(np.linalg.solve(linear.capacitance, linear.conductance))
        return np.asarray((rates.real > 0).all(axis=-1) & found)

    def following(self, v_in: Array, slope: Array, duration: Array) -> tuple[Array, Mask]:
        """Return the nodes behind an input that changes slowly, and where they are that; unchecked.

        They lag by ``-G^-1*(C*dr/du + c_in)*du/dt`` behind those at rest, r(u), but for the square of it.

        Parameters
        ----------
        v_in : ndarray
            Input voltage [V], shape [...].
        slope : ndarray
            Its slope up to here [V/s], shape [...].
        duration : ndarray
            For how long it has had that slope [s]; broadcasts.

        Returns
        -------
        tuple
            Voltages [V], shape [..., n], and mask of the shape [...]: stable, the transient of whatever came before is
            over, and the lag is small.
        """
        rest = self.operating_point(v_in)
        found: Mask = np.asarray(np.isfinite(rest).all(axis=-1))
        safe = np.where(found[..., None], rest, self.start(v_in))
        linear = self.evaluate(safe, v_in)[1]
        moved = -np.linalg.solve(linear.conductance, linear.input_conductance[..., None])
        charge = (linear.capacitance @ moved)[..., 0] + linear.input_capacitance
        lag = -np.linalg.solve(linear.conductance, charge[..., None])[..., 0] * slope[..., None]
        rates = np.linalg.eigvals(np.linalg.solve(linear.capacitance, linear.conductance)).real.min(axis=-1)
        slow = (rates * duration >= _DECAYED) & (np.abs(lag).max(axis=-1) <= _LEAST_LAG)
        return rest + lag, np.asarray(found & slow)
