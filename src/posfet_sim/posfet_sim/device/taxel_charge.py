# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charge at the gates of the simulated taxels, integrated only where there is any.

Force and temperature are piecewise linear between scans (first-order hold), for which the charge leakage is integrated
exactly, whatever the step h: ``sigma1 = sigma0*exp(-h/tau) + (q1 - q0)*(1 - exp(-h/tau))/(h/tau)`` with
``q = force*d33/A + p*dT`` (`posfet_model.device.charge`), each taxel with its own coefficients. Taxels that were never
loaded, and those whose charge has decayed, are *inactive*: they keep their state and cost nothing. The active ones are
stored in compact arrays, and several scans are computed in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import EDGE_NEIGHBOURS, dilate, neighbour_table
from posfet_sim.device.film import Film
from posfet_sim.device.play_operators import play_outputs
from posfet_sim.device.pole_bank import NEGLIGIBLE_STATE
from posfet_sim.device.taxel_variation import TaxelParameters
from posfet_sim.loads import Patch

NEGLIGIBLE_CHARGE: Final = 1e-13
"""Charge that counts as none, relative to that of the full-scale force [1]."""
DEACTIVATE_INTERVAL: Final = 256
"""Number of steps after which taxels without charge are deactivated."""
PLAY_HALF_WIDTHS: Final = (0.05, 0.10, 0.20)
"""Half-widths of the play operators of the film, relative to the full-scale force [1]; assumed."""


class TaxelCharge:
    """Charge of each taxel from forces and film temperature; starts without charge, and without force unless set.

    Hysteresis is a Prandtl-Ishlinskii model (A. Visintin, Differential Models of Hysteresis, 1994, ch. III): the
    effective force is ``F - w*sum(F - p_k)``, where p_k is the output of a play operator of half-width r_k. The model
    is rate-independent, so a constant force changes nothing. With r_k as in `PLAY_HALF_WIDTHS`, w is the loop width
    over the full-scale force divided by 0.7. As in Rayleigh's law, small changes of force have less effect than large
    ones, by up to 3*w.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    parameters : TaxelParameters
        Properties of each taxel; their dtype is that of the computation.
    hysteresis : float
        Width of the hysteresis loop relative to the full-scale force [1].
    compute_all : bool
        Whether to keep every taxel active.
    film : Film, optional
        Response of a real film, which keeps every taxel active; default: an ideal film.
    """

    def __init__(
        self,
        sensor: Sensor,
        parameters: TaxelParameters,
        hysteresis: float,
        compute_all: bool,
        film: Film | None = None,
    ) -> None:
        compute_all = compute_all or film is not None
        layout, dtype = sensor.layout, parameters.charge_per_newton.dtype
        self.updates = 0
        """Number of updates of the charge of one taxel so far."""
        self.active = np.arange(layout.taxels if compute_all else 0)
        """Indices of the active taxels, ascending."""
        self.charge: Array = np.zeros(0, dtype)
        """Charge density of the active taxels [C/m2]."""
        self._parameters = parameters
        self._compute_all = compute_all
        self._film = film
        largest = float(np.abs(parameters.charge_per_newton).max(initial=0.0))
        self._negligible = NEGLIGIBLE_CHARGE * sensor.device.force_max * largest
        self._patches: tuple[Patch, ...] = ()
        self._is_active = np.zeros((layout.rows, layout.cols), np.bool_)
        self._neighbours = neighbour_table(layout, EDGE_NEIGHBOURS)
        self._weight = hysteresis / (2 * sum(PLAY_HALF_WIDTHS))
        half_widths = np.array(PLAY_HALF_WIDTHS if hysteresis else (), dtype)[:, None]
        self._half_widths: Array = half_widths * sensor.device.force_max
        self._all_charge: Array = np.zeros(layout.taxels, dtype)
        self._all_source = np.zeros(layout.taxels, dtype)
        self._all_plays = np.zeros((len(self._half_widths), layout.taxels), dtype)
        self._steps = 0
        # Of the active taxels: source and play outputs of the last scan, and coefficients.
        self._source: Array
        self._plays: Array
        self._rate: Array
        self._set_active(np.full((layout.rows, layout.cols), compute_all, np.bool_))

    def start_under(self, force: Array) -> None:
        """Start under forces whose charge has leaked away; before the first scan only.

        Parameters
        ----------
        force : numpy.ndarray
            Force on every taxel [N], shape [rows * cols].
        """
        force = force.astype(self.charge.dtype, copy=False)
        if self._half_widths.size:
            self._all_plays = np.clip(0.0, force - self._half_widths, force + self._half_widths)
        # The same sum as in `_effective_force`, of plays that started at 0.
        effective = force * (1 - self._weight * len(self._half_widths)) + self._weight * self._all_plays.sum(axis=0)
        source = effective * self._parameters.charge_per_newton
        if self._film is not None:
            response = self._film.start_under(force[None], effective[None])
            source = (response.force * self._parameters.charge_per_newton)[0]
            rise = response.temperature_rise
            source += ((rise if rise.ndim > 1 else rise[:, None]) * self._parameters.charge_per_kelvin)[0]
        self._all_source = source.astype(self.charge.dtype, copy=False)
        self._source = self._all_source[self.active]
        self._plays = self._all_plays[:, self.active]

    def activate(self, patches: Sequence[Patch]) -> None:
        """Activate the taxels under these forces and under those of the previous call, and their neighbours."""
        changed, self._patches = (*self._patches, *patches), tuple(patches)
        if self.active.size == self._is_active.size or all(
            self._is_active[patch.rows, patch.cols].all() for patch in changed
        ):
            return
        active = self._is_active.copy()
        for patch in changed:
            active[_with_neighbours(patch.rows, active.shape[0]), _with_neighbours(patch.cols, active.shape[1])] = True
        self._set_active(active)

    def activate_all(self) -> None:
        """Activate every taxel, if the film is pyroelectric."""
        if self.active.size < self._is_active.size and self._parameters.charge_per_kelvin.any():
            self._set_active(np.ones_like(self._is_active))

    def advance(self, force: Array, temperature_rise: Array, steps: Array) -> Array:
        """Advance by several scans.

        Parameters
        ----------
        force : numpy.ndarray
            Force on every taxel [N], shape [scans, rows * cols].
        temperature_rise : numpy.ndarray
            Film temperature above that at the start [K], shape [scans].
        steps : numpy.ndarray
            Interval since the previous scan [s], shape [scans].

        Returns
        -------
        numpy.ndarray
            Charge density before the first scan and at each scan [C/m2], shape [scans + 1, active].
        """
        if force.shape[1] > self.active.size:
            force = force[:, self.active]
        dtype = self.charge.dtype
        force, steps = force.astype(dtype, copy=False), steps.astype(dtype, copy=False)
        sources = np.empty((len(steps) + 1, self.active.size), dtype)
        sources[0] = self._source
        effective, leak_factor = self._effective_force(force), None
        if self._film is not None:
            response = self._film.respond(force, effective, temperature_rise, steps)
            effective, temperature_rise, leak_factor = response.force, response.temperature_rise, response.leak_factor
        sources[1:] = effective
        sources[1:] *= self._per_newton
        if temperature_rise.any():
            rise = temperature_rise.astype(dtype, copy=False)
            sources[1:] += (rise if rise.ndim > 1 else rise[:, None]) * self._per_kelvin
        uniform = leak_factor is None and steps.min() == steps.max()
        exponent = np.multiply.outer(steps[:1] if uniform else steps, self._rate)
        if leak_factor is not None:
            exponent *= leak_factor.astype(dtype, copy=False)
        lost = np.expm1(exponent)
        decay = np.broadcast_to(1 + lost, (len(steps), self.active.size))
        charge = np.empty_like(sources)
        charge[0] = self.charge
        np.multiply(lost / exponent, np.diff(sources, axis=0), out=charge[1:])
        for before, after, left in zip(charge[:-1], charge[1:], decay, strict=True):
            np.add(after, before * left, out=after)
        self._source = sources[-1]
        if self._film is not None:
            charge[-1][np.abs(charge[-1]) < NEGLIGIBLE_STATE] = 0.0
        return self._store(charge)

    def decay(self, times: Array) -> Array:
        """Advance while force and temperature are constant.

        Parameters
        ----------
        times : numpy.ndarray
            Times since the last scan [s], shape [times].

        Returns
        -------
        numpy.ndarray
            Charge density [C/m2], shape [times, active].
        """
        times = times.astype(self.charge.dtype, copy=False)
        return self._store(np.exp(np.multiply.outer(times, self._rate)) * self.charge)

    def deactivate_discharged(self) -> bool:
        """Every `DEACTIVATE_INTERVAL` steps, deactivate taxels without charge whose neighbours have none, too.

        Returns
        -------
        bool
            Whether there was one.
        """
        if self._compute_all or self._steps < DEACTIVATE_INTERVAL:
            return False
        self._steps = 0
        return self._deactivate()

    def _store(self, charge: Array) -> Array:
        self.charge = charge[-1]
        self.updates += (len(charge) - 1) * self.active.size
        self._steps += len(charge) - 1
        return charge

    def _effective_force(self, force: Array) -> Array:
        """Return the effective forces [N] after the hysteresis of the film, shape [scans, active]."""
        if not self._half_widths.size:
            return force
        plays = play_outputs(force, self._plays, self._half_widths)
        self._plays = plays[-1]
        effective: Array = force * (1 - self._weight * len(self._half_widths))
        effective += self._weight * plays.sum(axis=1)
        return effective

    def _set_active(self, active: NDArray[np.bool_]) -> None:
        """Make these taxels the active ones."""
        if self.charge.size:
            self._all_charge[self.active] = self.charge
            self._all_source[self.active] = self._source
            self._all_plays[:, self.active] = self._plays
        self._is_active = active
        self.active = np.flatnonzero(active)
        self.charge = self._all_charge[self.active]
        self._source = self._all_source[self.active]
        self._plays = self._all_plays[:, self.active]
        self._per_newton = self._parameters.charge_per_newton[self.active]
        self._per_kelvin = self._parameters.charge_per_kelvin[self.active]
        self._rate = -1 / self._parameters.leak_time_constant[self.active]

    def _deactivate(self) -> bool:
        """Deactivate taxels without charge whose neighbours have none, too; return whether there was one."""
        charged = np.zeros_like(self._is_active)
        charged.flat[self.active] = np.abs(self.charge) > self._negligible
        near = dilate(charged.ravel(), self._neighbours).reshape(charged.shape) & self._is_active
        if near.sum() > 3 * self.active.size // 4:  # would save too little
            return False
        self._set_active(near)
        self._all_charge[~near.ravel()] = 0.0
        return True


def _with_neighbours(part: slice, size: int) -> slice:
    return slice(max(part.start - 1, 0), min(part.stop + 1, size))
