# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Transfer functions, loop gain and step of a linearised circuit, exact, as sums of as many poles as there are nodes.

With ``C*x' + G*x = -(c*u' + g*u)`` they are made of the eigenvectors of ``C^-1*G``. Arrays are of the circuits' shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.roots import false_position
from posfet_model._lib.types import Array, Mask
from posfet_model.amplifier.transient import Matrices

_FREQUENCIES: Final = np.geomspace(1e-2, 1e12, 71)
_STEPS: Final = 11
"""Evaluations that place a crossing between two of the frequencies, to rounding where the gain falls evenly."""

_INSTANTS: Final = 700
"""Instants at which a step is evaluated, evenly spaced in their logarithm."""

_LAST_INSTANT: Final = 12.0
"""The last of them, in time constants of the slowest mode that matters."""

_FIRST_INSTANT: Final = 1e-5
"""Most of the first one, in the same unit."""

_BEFORE_THE_FASTEST: Final = 0.01
"""And in time constants of the fastest mode that matters."""

_MATTERS: Final = 1e-3
"""Share of the final value from which on a mode matters: those below it leave a step within 1 % from the start."""


@dataclass(frozen=True, eq=False)
class TransferFunction:
    """``H(s) = direct + sum(residue/(s + rate))``; arrays of the circuits' shape, the last axis over the poles."""

    direct: NDArray[np.complex128]
    """Feed-through at infinite frequency [V/V], shape [...]."""
    residues: NDArray[np.complex128]
    """[V/V/s], shape [..., n]."""
    rates: NDArray[np.complex128]
    """Poles times -1 [1/s], shape [..., n], slowest first; unstable where a real part is not positive."""

    @property
    def gain(self) -> Array:
        """Gain at frequency 0 [V/V]."""
        return np.asarray((self.direct + (self.residues / self.rates).sum(axis=-1)).real)

    @property
    def stable(self) -> Mask:
        """Whether all poles are in the left half-plane."""
        return np.asarray((self.rates.real > 0).all(axis=-1))

    @property
    def bandwidth(self) -> Array:
        """First frequency at which the gain has fallen by 3 dB from that at frequency 0 [Hz]; NaN where it never is."""
        wanted = math.sqrt(0.5) * np.abs(self.gain)
        grid = _FREQUENCIES.reshape(-1, *(1,) * wanted.ndim)
        last = _last_above(np.abs(self.at(np.broadcast_to(grid, (grid.size, *wanted.shape)))), wanted)
        return np.where(last >= 0, _falls_through(self.at, wanted, last), np.nan)

    def at(self, frequency: Array) -> NDArray[np.complex128]:
        """Return H(j*2*pi*f) at frequencies [Hz] that broadcast with the circuits' shape; unchecked."""
        s = 2j * math.pi * np.asarray(frequency)[..., None]
        return np.asarray(self.direct + (self.residues / (s + self.rates)).sum(axis=-1))

    def step(self, time: Array) -> Array:
        """Return the response [V/V] to a unit step at times [s] that broadcast with the circuits' shape; unchecked."""
        parts, elapsed = self.residues / self.rates, np.asarray(time)[..., None]
        modes = np.exp(np.minimum(-self.rates.real * elapsed, 600.0))  # 600: of an unstable circuit
        weight = np.where(self.rates.imag == 0, parts.real, 0.0)
        rings = self.rates.imag > 0  # and its conjugate
        if rings.any():
            phase, amplitude = (self.rates.imag * elapsed)[..., rings], 2 * parts[rings]
            modes[..., rings] *= amplitude.real * np.cos(phase) + amplitude.imag * np.sin(phase)
            weight[rings] = 1.0
        return np.asarray((self.direct + parts.sum(axis=-1)).real - np.einsum("...k,...k->...", modes, weight))


@dataclass(frozen=True, eq=False)
class Modes:
    """Eigenvectors of ``C^-1*G``, of which every transfer function of the circuit is made; unchecked."""

    linear: Matrices
    """The linearised circuit."""
    rates: NDArray[np.complex128]
    """Eigenvalues [1/s], shape [..., n], slowest first."""
    vectors: NDArray[np.complex128]
    """Eigenvectors as columns, shape [..., n, n]."""

    @classmethod
    def of(cls, linear: Matrices) -> Modes:
        """Return the modes of a linearised circuit; unchecked."""
        rates, vectors = np.linalg.eig(np.linalg.solve(linear.capacitance, linear.conductance))
        order = np.argsort(np.abs(rates), axis=-1)
        return cls(
            linear,
            np.take_along_axis(rates, order, -1).astype(np.complex128),
            np.take_along_axis(vectors, order[..., None, :], -1).astype(np.complex128),
        )

    def driven(self, conductance: Array, capacitance: Array) -> tuple[NDArray[np.complex128], Array]:
        """Return the residues of the modes [1/s], and the nodes at infinite frequency, per volt of an input; unchecked.

        Parameters
        ----------
        conductance, capacitance : ndarray
            Columns of the input [S], [F], shape [..., n].

        Returns
        -------
        tuple of ndarray
            Both of shape [..., n].
        """
        columns = np.linalg.solve(self.linear.capacitance, np.stack([conductance, capacitance], axis=-1))
        parts = np.linalg.solve(self.vectors, columns.astype(np.complex128))
        return np.asarray(self.rates * parts[..., 1] - parts[..., 0]), np.asarray(-columns[..., 1])

    def transfer(self, conductance: Array, capacitance: Array, output: int) -> TransferFunction:
        """Return the transfer function from an input to a node; unchecked.

        Parameters
        ----------
        conductance, capacitance : ndarray
            Columns of the input [S], [F], shape [..., n].
        output : int
            Index of the node.

        Returns
        -------
        TransferFunction
            Its poles and residues.
        """
        residues, direct = self.driven(conductance, capacitance)
        return TransferFunction(
            direct[..., output].astype(np.complex128), self.vectors[..., output, :] * residues, self.rates
        )


def transfer_function(linear: Matrices, output: int) -> TransferFunction:
    """Return the transfer function from the input to a node; unchecked.

    Parameters
    ----------
    linear : Matrices
        The linearised circuit.
    output : int
        Index of the node.

    Returns
    -------
    TransferFunction
        Its poles and residues.
    """
    return Modes.of(linear).transfer(linear.input_conductance, linear.input_capacitance, output)


@dataclass(frozen=True, eq=False)
class LoopGain:
    """Loop gain T of a follower, as ``1/(1 + T)``: the share of a disturbance in the loop that remains.

    The loop is cut between the output and the inverting input without a change of either's load, with the voltage and
    the current there in turn: R. D. Middlebrook, Int. J. Electronics 38 (1975) 485, doi:10.1080/00207217508920421,
    ``1/(1 + T) = 1/(1 + Tv) + 1/(1 + Ti)``. Both terms are responses of the closed loop, and so is their sum.
    """

    remainder: TransferFunction
    """1/(1 + T)."""

    def at(self, frequency: Array) -> NDArray[np.complex128]:
        """Return T(j*2*pi*f) at frequencies [Hz] that broadcast with the circuits' shape; unchecked."""
        return np.asarray(1 / self.remainder.at(frequency) - 1)


def loop_gain(modes: Modes, held: Matrices, output: int) -> LoopGain:
    """Return the loop gain of a follower; unchecked.

    Parameters
    ----------
    modes : Modes
        Those of the follower.
    held : Matrices
        The circuit with its inverting input held.
    output : int
        Index of the output, to which nothing but the follower's connection couples the inverting input.

    Returns
    -------
    LoopGain
        The loop gain.
    """
    whole = modes.linear
    # In the closed loop, row and column of the output are its own plus those of the inverting input.
    columns = (whole.conductance - held.conductance)[..., output], (whole.capacitance - held.capacitance)[..., output]
    voltage = modes.transfer(*columns, output)
    row = (whole.capacitance - held.capacitance)[..., output, :]
    unit = np.broadcast_to(np.arange(row.shape[-1]) == output, row.shape).astype(np.float64)
    injected, _ = modes.driven(-unit, np.zeros_like(unit))
    current = (row[..., None, :] @ modes.vectors)[..., 0, :] * injected  # times s: the gate takes no current at rest
    return LoopGain(
        TransferFunction(
            1 + voltage.direct + current.sum(axis=-1), voltage.residues - modes.rates * current, modes.rates
        )
    )


def unity_crossing(response: LoopGain) -> tuple[Array, Array]:
    """Return the first frequency [Hz] at which the gain falls through 1, and the phase margin there [degrees]."""
    shape = response.remainder.direct.shape
    grid = _FREQUENCIES.reshape(-1, *(1,) * len(shape))
    values = response.at(np.broadcast_to(grid, (len(grid), *shape)))
    last = _last_above(np.abs(values), 1.0)
    crossed, at = last >= 0, np.maximum(last, 0)
    low = _falls_through(response.at, np.ones(shape), last)
    phase = np.unwrap(np.angle(values), axis=0)
    before = np.take_along_axis(phase, at[None], 0)[0] - phase[0] + np.angle(values[0])
    phase_at = np.angle(response.at(low))
    phase_at = before + (phase_at - before + math.pi) % (2 * math.pi) - math.pi
    return np.where(crossed, low, np.nan), np.where(crossed, 180 + np.rad2deg(phase_at), np.nan)


def _last_above(magnitude: Array, level: Array | float) -> NDArray[np.intp]:
    """Return the index of the last frequency before a gain [f, ...] first falls to a level, -1 if it starts below.

    The gain is at rest at the first frequency, and far below the level at the last.
    """
    return np.asarray(np.argmin(magnitude > level, axis=0) - 1)


def _falls_through(transfer: Callable[[Array], NDArray[np.complex128]], level: Array, last: NDArray[np.intp]) -> Array:
    """Return the frequency [Hz] behind that of the index `last` at which the gain falls through a level."""
    at = np.maximum(last, 0)
    low, high = np.log(_FREQUENCIES)[at], np.log(_FREQUENCIES)[np.minimum(at + 1, _FREQUENCIES.size - 1)]

    def excess(log_frequency: Array) -> Array:
        return np.asarray(np.log(np.abs(transfer(np.exp(log_frequency))) / level))

    with np.errstate(divide="ignore", invalid="ignore"):  # of a gain of 0
        return np.exp(false_position(excess, low, high, _STEPS))


def step_figures(response: TransferFunction, thinning: int = 1) -> tuple[Array, Array]:
    """Return overshoot [1] and settling time to 1 % [s] of a step, of each `thinning`-th instant; unchecked."""
    time = _step_times(response, thinning)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value = response.step(time) / response.gain
    outside = np.abs(value - 1) > 0.01
    last = len(time) - 1 - np.argmax(outside[::-1], axis=0)
    following = np.minimum(last + 1, len(time) - 1)
    return np.maximum(np.nanmax(value, axis=0) - 1, 0.0), np.take_along_axis(time, following[None], 0)[0]


def _step_times(response: TransferFunction, thinning: int) -> Array:
    """Return the instants of a step [s], shape [t, ...]: 0, and from the fastest mode that matters to the slowest."""
    rates = response.rates
    matters = np.abs(response.residues) > _MATTERS * np.abs(rates * response.gain[..., None])
    slowest = 1 / np.maximum(np.where(matters, rates.real, np.inf).min(axis=-1), 1e-30)
    fastest = np.where(matters, np.abs(rates), 0.0).max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.fmin(_FIRST_INSTANT, _BEFORE_THE_FASTEST / (fastest * slowest))
    share = np.linspace(0.0, 1.0, _INSTANTS).reshape(-1, *(1,) * slowest.ndim)
    time = np.concatenate([np.zeros((1, *slowest.shape)), first ** (1 - share) * _LAST_INSTANT**share])
    return np.asarray(time[::thinning] * slowest)
