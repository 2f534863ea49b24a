# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a touch leaves in the signals besides its force: responses of leak, creep, warmth and bending to it.

All are simulated from the estimated force of the touched taxels, never from the measured signals: those are noise at
rest, which would explain everything.
"""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.estimation.error_states import COUNT, CREEPS, LOOPS, ErrorPriors, Shared
from posfet_model.sensor.description import Layout


def without(force: Array, steepness: float | Array) -> Array:
    """Return what thermal contacts lack to be whole [1], by the force relative to that at which they saturate."""
    lacks: Array = np.exp(-(force**steepness))
    return lacks


class TouchResponse:
    """Responses of the force errors to the shared states.

    State variables: the force that creep follows with each time constant [N], shape [creep, taxels]; the remaining
    charge of the touched force [N], and the warmth of each taxel relative to the steady one [1], shapes [taxels].

    Parameters
    ----------
    layout : Layout
        The array.
    time_constant : ndarray of float64, shape [taxels]
        Leakage time constants [s].
    newton_per_kelvin : ndarray of float64, shape [taxels]
        Pyroelectric signal of each taxel [N/K].
    priors : ErrorPriors
        Time constants of creep and warmth.
    """

    def __init__(self, layout: Layout, time_constant: Array, newton_per_kelvin: Array, priors: ErrorPriors) -> None:
        taxels = layout.taxels
        rows, cols = np.divmod(np.arange(taxels), layout.cols)
        self._x = (cols - 0.5 * (layout.cols - 1)) / max(0.5 * (layout.cols - 1), 0.5)
        self._y = (rows - 0.5 * (layout.rows - 1)) / max(0.5 * (layout.rows - 1), 0.5)
        self._profile = np.array(priors.bend_profile or np.ones(taxels))
        self._tau = time_constant
        self._per_kelvin = newton_per_kelvin
        self._warmth_time, self._warmth_force = priors.warmth_time, priors.warmth_force
        self._warmth_steepness = priors.warmth_steepness
        self._warmth_force_spread, self._warmth_certain = priors.warmth_force_spread, priors.warmth_certain
        self._creep_times = np.array(priors.creep_times)
        self._half_widths = np.array(priors.loop_half_widths)[:, None]
        self._weights, self._slope = np.array(priors.loop_weights), priors.loop_slope
        self._chip_times, self._chip_warming = np.array(priors.chip_times), np.array(priors.chip_warming)
        self._warmed = np.zeros(len(self._chip_times))
        self.warming = 0.0
        """Rate of the chip temperature that the touch is expected to cause [K/s]."""
        self._plays = np.zeros((LOOPS, taxels))
        self.loops = np.zeros(taxels)
        """Charge by which the film's hysteresis differs from that of the force, as a force [N], shape [taxels]."""
        self._followed = np.zeros((CREEPS, taxels))
        self._charge = np.zeros(taxels)
        self._force = np.zeros(taxels)
        self.warm = np.zeros(taxels)
        """Warmth of each taxel relative to the steady one [1], shape [taxels]."""
        self._certain = np.zeros(taxels)  # the same by what the forces were at least
        self.range = np.zeros(taxels)
        """By how much the greatest thermal contact that there may be differs from the least [1], shape [taxels]."""
        self.responding = False
        """Whether anything has touched."""

    def reset(self) -> None:
        """Forget all touches."""
        self._followed[:] = self._plays[:] = self.loops[:] = 0.0
        self._charge = np.zeros_like(self._charge)
        self._force = np.zeros_like(self._force)
        self.warm[:] = self._certain[:] = self.range[:] = self._warmed[:] = 0.0
        self.warming = 0.0
        self.responding = False

    @property
    def leaked(self) -> Array:
        """Leaked charge of the touched force, as a force [N], shape [taxels]."""
        leaked: Array = self._force - self._charge
        return leaked

    def advance(
        self, force: Array, least: Array, most: Array, duration: float, leak: float = 0.0, warmth: float = 0.0
    ) -> None:
        """Advance by a block.

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Mean touched force [N]; 0 where untouched.
        least : ndarray of float64, shape [taxels]
            What it is at least [N].
        most : ndarray of float64, shape [taxels]
            What it is at most [N].
        duration : float
            Duration of the block [s].
        leak : float, optional
            Relative error of the leak rates as far as it is known [1], > -1: the charge leaks with ``tau*(1 + leak)``.
        warmth : float, optional
            Warmth of a touched taxel as far as it is known [K].
        """
        self.responding |= bool(force.any())
        if not self.responding:
            return
        share = -np.expm1(-duration / self._creep_times)[:, None]
        self._followed += share * (force - self._followed)
        ratio = duration / (self._tau * (1.0 + leak))
        left = np.exp(-ratio)
        self._charge = self._charge * left + (force - self._force) * (1.0 - left) / ratio
        self._force = force
        self._plays = np.clip(self._plays, force - self._half_widths, force + self._half_widths)
        self.loops = self._weights @ (force - self._plays) - self._slope * force
        follows = -np.expm1(-duration / self._chip_times) * (float(force.sum()) - self._warmed)
        self._warmed += follows
        self.warming = float(self._chip_warming @ follows) / duration
        # The thermal contact saturates. By what a force seems to be it is no more than keeps no force up: a film that
        # warms hides at most as much of a force as there is; nor is it steep, then. What a force is at least has all.
        own = np.maximum(self._warmth_force, -self._per_kelvin * warmth)
        whole, steep = self._warmth_force, self._warmth_steepness
        steepness = np.maximum(steep * (whole / own) ** 2, min(steep, 1.0))
        certain = self._warmth_certain * (1.0 - without(least / whole, steep))
        contact = np.maximum(1.0 - without(force / own, steepness), certain)
        warming = -np.expm1(-duration / self._warmth_time)
        self._certain += warming * (certain - self._certain)
        self.warm += warming * (contact - self.warm)
        between = without(least / own, steepness) - without(most * self._warmth_force_spread / whole, steep)
        self.range += warming * (between - self.range)

    def reduce_warmth(self, where: Mask, left: Array, warmth: float) -> None:
        """Take what is left of released forces for their own warmth, as far as that was only the force's.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels that were released.
        left : ndarray of float64, shape [taxels]
            What is left of their forces [N].
        warmth : float
            Warmth of a touched taxel as far as it is known [K].
        """
        per_warm = -self._per_kelvin * warmth
        where = where & (left > 0.0) & (per_warm > 0.0) & (self._warmth_certain > 0.0)
        own = np.minimum(left, per_warm * np.maximum(self.warm - self._certain, 0.0))
        self.warm -= np.divide(own, per_warm, out=np.zeros_like(own), where=where)

    def matrix(self) -> Array:
        """Return the responses h of the force errors to the shared states, shape [taxels, COUNT]."""
        response = np.zeros((len(self._tau), COUNT))
        response[:, Shared.FILM] = self._per_kelvin
        if self.responding:
            total = float(self._force.sum())
            response[:, Shared.BEND] = total * self._profile
            response[:, Shared.BEND_X] = total * self._x
            response[:, Shared.BEND_Y] = total * self._y
            moment_x, moment_y = float(self._force @ self._x), float(self._force @ self._y)
            response[:, Shared.BEND_MOMENT] = moment_x * self._x + moment_y * self._y
            response[:, Shared.LEAK] = self.leaked
            response[:, Shared.WARMTH] = self._per_kelvin * self.warm
            response[:, Shared.WEAK_WARMTH] = self._per_kelvin * self.range
            response[:, Shared.CREEP :] = self._followed.T
        return response
