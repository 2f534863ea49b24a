# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Response of a real film: what the charge source of each taxel and the charge leakage depend on, beyond force.

In this order, each effect only where it is on:

1. hysteresis (play operators) and nonlinearity with preload act on the force F on a taxel,
2. bending of the chip adds a share of the total force,
3. relaxation and creep let the response to the sum grow with time (`PoleBank`),
4. the temperature of the film changes d33, and the gain drifts,
5. the object warms the film of the taxels it touches, which generates pyroelectric charge,
6. leakage follows the film temperature and drifts.

The forces given are never changed: they stay the ground truth. Tangential force and the charge it would generate by d31
and d32 are not simulated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout, Sensor
from posfet_sim.device.film_effects import FilmEffects
from posfet_sim.device.play_operators import play_outputs
from posfet_sim.device.pole_bank import PoleBank
from posfet_sim.device.random_streams import Stream, generator
from posfet_sim.device.random_walk import RandomWalk

REFERENCE_TEMPERATURE: Final = 25.0
"""Film temperature at which d33 and leakage are those of the calibration [degC]; assumed."""

POLES_PER_DECADE: Final = 2
"""Number of relaxation poles per decade; the rate per decade is then uniform to 0.2 %: the ripple of
``sum(1 - exp(-t/tau_k))`` over log-uniform tau_k of the log-spacing D is ``2*|Gamma(1 + 2j*pi/D)|`` of its slope."""
RELAXATION_TIME_CONSTANTS: Final = tuple(3e-3 * 10 ** (index / POLES_PER_DECADE) for index in range(9))
"""Time constants of the dielectric relaxation, 3 ms to 30 s [s]; assumed."""
CREEP_TIME_CONSTANTS: Final = (1.0, 10.0**0.5, 10.0)
"""Time constants of the viscoelastic creep, with equal shares [s]; assumed."""
MINOR_HALF_WIDTHS: Final = (0.005, 0.01, 0.02, 0.04)
"""Half-widths of the play operators of the minor loops, relative to the full-scale force [1]; assumed."""
WARMTH_FORCE: Final = 0.05
"""Force on a taxel [N] at which it has 1 - 1/e of the contact with an object that it can have; assumed."""
CHIP_TIME_CONSTANT: Final = 5.0
"""Time constant with which an object warms the chip [s]; assumed."""


@dataclass(frozen=True, eq=False)
class FilmResponse:
    """What the charge of each taxel follows, at several scans."""

    force: NDArray[np.float64]
    """Force with which an ideal film would have the same piezoelectric charge [N], shape [scans, taxels]."""
    temperature_rise: NDArray[np.float64]
    """The same for the film temperature above that at the start [K], shape [scans] or [scans, taxels]."""
    leak_factor: NDArray[np.float64] | None
    """Mean rate of the charge leakage since the previous scan, relative to the nominal one [1], shape [scans, 1] or
    [scans, taxels]; None: 1."""


class Film:
    """Film with the given effects; starts at rest, and unloaded unless set.

    Play operators are exact for a force that is linear between scans; relaxation, creep and warmth are exact for inputs
    that are, which are nonlinear functions of the force where preload and warmth are on. The charge source is linear
    between its values at the scans: its curvature within a step affects only what leaks in that step.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    effects : FilmEffects
        Effects.
    start_temperature : float
        Film temperature at the start [degC].
    seed : int
        Seed of the board; drift of leakage and drift of gain have a random stream each.
    """

    def __init__(self, sensor: Sensor, effects: FilmEffects, start_temperature: float, seed: int) -> None:
        taxels = sensor.layout.taxels
        self._effects = effects
        self._start_rise = start_temperature - REFERENCE_TEMPERATURE
        self._time = 0.0
        self._half_widths = np.array(MINOR_HALF_WIDTHS)[:, None] * sensor.device.force_max
        self._plays = np.zeros((len(MINOR_HALF_WIDTHS), taxels)) if effects.minor_loops else None
        self._bending = _bending_shapes(sensor.layout, effects.bending_gradient) if effects.bending else None
        self._delayed = _delayed_response(effects, taxels)
        self._warmth = (
            PoleBank((effects.contact_warmth_time,), (effects.contact_warmth,), taxels)
            if effects.contact_warmth
            else None
        )
        self._leak_walk = RandomWalk(seed, Stream.LEAK_DRIFT, taxels + 1) if effects.leak_drift else None
        self._leak_before = self._leak_now(np.zeros(1), np.zeros(1))
        self._gain_rate = (
            effects.gain_drift * generator(seed, Stream.GAIN_DRIFT).standard_normal(taxels)
            if effects.gain_drift
            else None
        )

    def start_under(self, force: NDArray[np.float64], hysteretic_force: NDArray[np.float64]) -> FilmResponse:
        """Start under forces to which the film has responded completely; return what the charge follows.

        Parameters
        ----------
        force : numpy.ndarray
            Force on every taxel [N], shape [1, taxels].
        hysteretic_force : numpy.ndarray
            The same after the hysteresis between no force and full scale [N].
        """
        effective = self._prompt_force(force, hysteretic_force)
        if self._delayed is not None:
            self._delayed.start_under(effective[0])
        if self._warmth is not None:
            self._warmth.start_under(_touched(force)[0])
        return self.respond(force, hysteretic_force, np.zeros(1), np.zeros(1))

    def respond(
        self,
        force: NDArray[np.float64],
        hysteretic_force: NDArray[np.float64],
        temperature_rise: NDArray[np.float64],
        steps: NDArray[np.float64],
    ) -> FilmResponse:
        """Advance by several scans.

        Parameters
        ----------
        force : numpy.ndarray
            Force on every taxel [N], shape [scans, taxels].
        hysteretic_force : numpy.ndarray
            The same after the hysteresis between no force and full scale [N].
        temperature_rise : numpy.ndarray
            Temperature of the untouched film above that at the start [K], shape [scans].
        steps : numpy.ndarray
            Interval since the previous scan [s], shape [scans].

        Returns
        -------
        FilmResponse
            What the charge follows at these scans.
        """
        effects = self._effects
        times = self._time + np.cumsum(steps)
        self._time = times.item(-1)
        effective, rise = self._prompt_force(force, hysteretic_force), temperature_rise
        if self._delayed is not None:
            effective = effective + self._delayed.respond(effective, steps)
        if self._warmth is not None:
            rise = rise[:, None] + self._warmth.respond(_touched(force), steps)
        leak_factor = self._leak_factor(times, rise)
        if effects.d33_temperature:
            growth = np.exp(effects.d33_temperature * (self._start_rise + rise))
            effective = effective * (growth if growth.ndim > 1 else growth[:, None])
        if self._gain_rate is not None:
            gain = np.exp(np.multiply.outer(times, self._gain_rate))
            effective = effective * gain
            rise = (rise if rise.ndim > 1 else rise[:, None]) * gain
        return FilmResponse(effective, rise, leak_factor)

    def _prompt_force(self, force: NDArray[np.float64], hysteretic_force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force after the effects that need no time [N]: minor loops, preload and bending."""
        effects, effective = self._effects, hysteretic_force
        if self._plays is not None:
            plays = play_outputs(force, self._plays, self._half_widths)
            self._plays = plays[-1]
            effective = effective - effects.minor_loops * (len(self._half_widths) * force - plays.sum(axis=1))
        if effects.preload_nonlinearity:
            effective = effective + (0.5 * effects.preload_nonlinearity) * effective**2
        if self._bending is not None:
            effective = effective + effects.bending * ((force @ self._bending) @ self._bending.T)
        return effective

    def _leak_factor(self, times: NDArray[np.float64], rise: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the mean relative rate of the leakage over each step; the rate is linear over a step."""
        now = self._leak_now(times, rise)
        if now is None or self._leak_before is None:
            return None
        before = np.concatenate([np.broadcast_to(self._leak_before, (1, now.shape[1])), now[:-1]])
        self._leak_before = now[-1:]
        mean: NDArray[np.float64] = (before + now) / 2
        return mean

    def _leak_now(self, times: NDArray[np.float64], rise: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the relative rate of the leakage at each time, shape [times, 1] or [times, taxels]."""
        effects = self._effects
        if not effects.leak_halving and self._leak_walk is None:
            return None
        rate = np.ones((len(times), 1))
        if effects.leak_halving:
            rises = rise if rise.ndim > 1 else rise[:, None]
            rate = np.exp2((self._start_rise + rises) / effects.leak_halving)
        if self._leak_walk is not None:
            walk = self._leak_walk.at(times)
            # Half of the variance is common to all taxels, such as that by humidity.
            rate = rate * np.exp(effects.leak_drift * math.sqrt(0.5) * (walk[:, :-1] + walk[:, -1:]))
        return rate


def _touched(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the contact of each taxel with an object [1] under a force [N]."""
    touched: NDArray[np.float64] = -np.expm1(np.maximum(force, 0.0) / -WARMTH_FORCE)
    return touched


def chip_warming(effects: FilmEffects) -> PoleBank | None:
    """Return the temperature rise of the chip [K] that the objects on it cause, from their total force [N].

    The heat capacity of the chip responds to the flow of heat from the objects, which grows with their force, with the
    time constant `CHIP_TIME_CONSTANT`. None if the effect is off.

    Parameters
    ----------
    effects : FilmEffects
        Effects.
    """
    return PoleBank((CHIP_TIME_CONSTANT,), (effects.chip_warming,), 1) if effects.chip_warming else None


def _delayed_response(effects: FilmEffects, taxels: int) -> PoleBank | None:
    """Return relaxation and creep as far as they are on; None if neither is."""
    time_constants: tuple[float, ...] = ()
    weights: tuple[float, ...] = ()
    if effects.relaxation:
        time_constants += RELAXATION_TIME_CONSTANTS
        weights += (effects.relaxation / POLES_PER_DECADE,) * len(RELAXATION_TIME_CONSTANTS)
    if effects.creep:
        time_constants += CREEP_TIME_CONSTANTS
        weights += (effects.creep / len(CREEP_TIME_CONSTANTS),) * len(CREEP_TIME_CONSTANTS)
    return PoleBank(time_constants, weights, taxels) if weights else None


def _bending_shapes(layout: Layout, gradient: float) -> NDArray[np.float64]:
    """Return S, shape [taxels, 3], for which bending by the forces F is proportional to ``F @ S @ S.T``.

    A force at r' acts on the taxel at r with ``1 + gradient*(r . r')/R^2``, R being the distance of a corner taxel.
    """
    positions = layout.positions - layout.positions.mean(axis=0)
    corner = max(float(np.hypot(*positions.T).max()), 1e-9)
    return np.column_stack([np.ones(len(positions)), positions * (gradient**0.5 / corner)])
