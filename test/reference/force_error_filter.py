# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The filter of the force errors as it was in Python, with which `posfet_core` agrees.

Given the shared states s, the errors of the taxels are independent: with t_i = (d_i, o_i, r_i, p_i, w_i), error of the
force, offset of the signal, small force beside a contact, relative error of the pyroelectric response, and the part of
the error that is the warmth of taxel i,

    t_i = m_i + G_i*(s - s^) + e_i,    cov(e_i) = V_i,    cov(s) = S.

A known force of taxel i measures ``z_i = d_i + r_i + h_i.s + noise``. The update eliminates the taxels one by one: each
adds ``g_i g_i'/v_i`` to the information on s, with ``g_i = h_i + a.G_i`` and ``v_i = a.V_i.a + R_i``, where a is
(1, 0, 1, 0, 0); then each taxel is updated given s. That costs O(taxels) instead of O(taxels^3), and is exact but for
what the process noise of s makes common to the taxels (docs/estimation.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.estimation.error_states import Shared
from reference.reductions import any_true

OWN: Final = 5
"""Number of states of each taxel."""


@dataclass
class Belief:
    """State of the filter: means and covariance of the force errors."""

    shared: Array
    """Shared states, shape [shared]; units as in `error_states.Shared`."""
    covariance: Array
    """Their covariance S, shape [shared, shared]."""
    error: Array
    """Errors of the forces d, offsets of the signals o, small forces r beside a contact, all [N], relative errors p of
    the pyroelectric responses [1], and the parts w of d that vanish as the film cools [N], shape [taxels, own]."""
    slope: Array
    """Regression G of the taxels' errors on the shared states, shape [taxels, own, shared]."""
    own: Array
    """Covariance V of the taxels' errors given the shared states [N2], shape [taxels, own, own]."""

    def copy(self) -> Belief:
        """Return an independent copy."""
        return Belief(self.shared.copy(), self.covariance.copy(), self.error.copy(), self.slope.copy(), self.own.copy())

    def integrate(self, leaked: Array, driven: Array) -> None:
        """Add to the force errors what causes them within a time, which may be negative.

        Parameters
        ----------
        leaked : ndarray of float64, shape [taxels]
            Share t/tau of an offset that the integration adds to the force in that time t [1].
        driven : ndarray of float64, shape [taxels, shared]
            What the shared states add to the force error in that time.
        """
        self.error[:, 0] += leaked * self.error[:, 1] + driven @ self.shared
        self.slope[:, 0] += leaked[:, None] * self.slope[:, 1] + driven
        self.own[:, 0] += leaked[:, None] * self.own[:, 1]
        self.own[:, :, 0] += leaked[:, None] * self.own[:, :, 1]

    def respond(self, expected: Array) -> None:
        """Add to the force errors what the taxels' own responses make of a change of the film's temperature.

        Parameters
        ----------
        expected : ndarray of float64, shape [taxels]
            Change of the force error that is expected of each taxel without its own deviation p [N].
        """
        self.error[:, 0] += expected * self.error[:, 3]
        self.slope[:, 0] += expected[:, None] * self.slope[:, 3]
        self.own[:, 0] += expected[:, None] * self.own[:, 3]
        self.own[:, :, 0] += expected[:, None] * self.own[:, :, 3]

    def cool(self, shares: Array) -> None:
        """Let the parts of the force errors that are the taxels' own warmth vanish.

        Parameters
        ----------
        shares : ndarray of float64, shape [taxels]
            Share of it that each taxel has lost [1].
        """
        lost, left = shares[:, None], 1.0 - shares[:, None]
        self.error[:, 0] -= shares * self.error[:, 4]
        self.slope[:, 0] -= lost * self.slope[:, 4]
        self.own[:, 0] -= lost * self.own[:, 4]
        self.own[:, :, 0] -= lost * self.own[:, :, 4]
        self.error[:, 4] *= 1.0 - shares
        self.slope[:, 4] *= left
        self.own[:, 4] *= left
        self.own[:, :, 4] *= left

    def forget_small_forces(self, where: Mask) -> None:
        """Set the small forces r of the masked taxels to zero, as they are not beside a contact."""
        where = where & (self.own[:, 2, 2] > 0.0)
        if any_true(where):
            self.error[where, 2] = 0.0
            self.forget(where, 2)

    def restart(self, state: int, mean: float, variance: float) -> None:
        """Restart a shared state with a variance, independent of all others."""
        self.shared[state] = mean
        self.covariance = self.covariance.copy()
        self.covariance[state] = self.covariance[:, state] = 0.0
        self.covariance[state, state] = variance
        self.slope[:, :, state] = 0.0

    def reset_force_error(self, where: Mask, shown: Array, response: Array, variance: Array) -> None:
        """Set the force errors of the masked taxels to what they show, less what the shared states cause.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels whose force is known.
        shown : ndarray of float64, shape [taxels]
            Uncorrected force less the known one [N].
        response : ndarray of float64, shape [taxels, shared]
            Responses of the force errors to the shared states.
        variance : ndarray of float64, shape [taxels]
            Variance of `shown` [N2].
        """
        self.forget(where, 0)
        self.error[where, 0] = (shown - response @ self.shared)[where]
        self.slope[where, 0] = -response[where]
        self.own[where, 0, 0] = variance[where]

    def forget(self, where: Mask | slice, state: int) -> None:
        """Make one state of the masked taxels exactly known and independent of all others.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels], or slice
            Taxels concerned.
        state : int
            Index of the state: 0 for d, 1 for o, 2 for r, 3 for p, 4 for w.
        """
        self.slope[where, state] = 0.0
        self.own[where, state] = 0.0
        self.own[where, :, state] = 0.0

    def own_variance(self) -> Array:
        """Return the variance of the errors of each force, d + r, given the shared states [N2], shape [taxels]."""
        own = self.own
        variance: Array = np.maximum(own[:, 0, 0] + 2.0 * own[:, 0, 2] + own[:, 2, 2], 0.0)
        return variance


ROUNDING: Final = 1e-12
"""Share of a variance that is rounding error [1]."""
NEGLIGIBLE: Final = 1e-14
"""Added to the correlation of each shared state with itself [1]: correlations are positive within rounding, then."""


def _roots(covariance: Array) -> tuple[Array, Array]:
    """Return a root L of a covariance LL', and L^-1, but for states that are known exactly: zero there."""
    deviation = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    weight = 1.0 / np.where(deviation > 0.0, deviation, np.inf)
    correlation = covariance * weight
    correlation *= weight[:, None]
    correlation.reshape(-1)[:: len(weight) + 1] = 1.0 + NEGLIGIBLE
    root = np.linalg.cholesky(correlation)
    return deviation[:, None] * root, np.linalg.inv(root) * weight


PAIRS: Final = tuple(combinations(range(OWN), 2))
"""Pairs of different states of a taxel."""


class ForceErrorFilter:
    """Predicts and updates a belief. Matrices are those of the module's docstring.

    Parameters
    ----------
    belief : Belief
        Belief at the start; changed in place.
    """

    def __init__(self, belief: Belief) -> None:
        self.belief = belief
        """The belief."""
        self._root, self._rooted = belief.covariance, np.zeros(0)  # a root, and the covariance that it belongs to

    def _covariance_root(self) -> Array:
        """Return a root of the shared states' covariance, which is known from the step before if there was one."""
        covariance = self.belief.covariance
        if self._rooted is not covariance:
            self._root, self._rooted = _roots(covariance)[0], covariance
        return self._root

    def predict(
        self, after: Array, matrix: Array, noise: Array, leaked: Array, driven: Array, own_noise: Array
    ) -> None:
        """Propagate over a block.

        Parameters
        ----------
        after : ndarray of float64, shape [shared]
            Shared states at its end.
        matrix : ndarray of float64, shape [shared, shared]
            Jacobian F of that transition.
        noise : ndarray of float64, shape [shared, shared]
            Covariance of the process noise Q of the shared states.
        leaked : ndarray of float64, shape [taxels]
            Share T/tau of an offset that the integration adds to the force in the block [1].
        driven : ndarray of float64, shape [taxels, shared]
            What the shared states add to the force errors in the block.
        own_noise : ndarray of float64, shape [taxels, own, own]
            Covariance of the process noise of each taxel [N2].
        """
        b = self.belief
        b.integrate(leaked, driven)
        b.own += own_noise
        self._become(matrix, noise)
        b.shared = after

    def admit(self, direction: Array, variance: float) -> None:
        """Raise the uncertainty of the shared states, independently of the taxels' errors.

        Parameters
        ----------
        direction : ndarray of float64, shape [shared]
            How the shared states may have changed together.
        variance : float
            Variance of the size of that change [1].
        """
        self._become(np.eye(len(direction)), np.outer(direction, direction) * variance)

    def widen(self, direction: Array, variance: float) -> None:
        """Raise the uncertainty of the shared states, and with it that of the taxels' errors, which follow from them.

        Parameters
        ----------
        direction : ndarray of float64, shape [shared]
            How the shared states may have been wrong together.
        variance : float
            Variance of the size of that error [1].
        """
        self.belief.covariance = self.belief.covariance + np.outer(direction, direction) * variance

    def _become(self, matrix: Array, noise: Array) -> None:
        """Replace the covariance of the shared states, and regress the taxels' errors on the new one.

        Parameters
        ----------
        matrix : ndarray of float64, shape [shared, shared]
            Jacobian F of the transition of the shared states.
        noise : ndarray of float64, shape [shared, shared]
            Covariance Q of the noise that they gain.
        """
        b = self.belief
        before, slope = b.covariance, b.slope
        flat = slope.reshape(-1, len(matrix))
        spread = flat @ before
        b.covariance = matrix @ before @ matrix.T + noise
        self._root, inverse = _roots(b.covariance)
        self._rooted = b.covariance
        white = spread @ matrix.T @ inverse.T
        b.slope = (white @ inverse).reshape(slope.shape)
        # What the noise takes from the regression stays as the taxel's own: each pair of its states.
        white, spread = white.reshape(slope.shape), spread.reshape(slope.shape)
        lost = np.einsum("tij,tij->ti", spread, slope) - np.einsum("tij,tij->ti", white, white)
        b.own.reshape(len(b.own), -1)[:, :: b.own.shape[1] + 1] += lost
        for i, j in PAIRS:
            both = np.einsum("tj,tj->t", spread[:, i], slope[:, j]) - np.einsum("tj,tj->t", white[:, i], white[:, j])
            b.own[:, i, j] += both
            b.own[:, j, i] += both

    def innovation(self, measured: Array, response: Array, noise: Array) -> tuple[Array, Array, Array]:
        """Return the residuals [N], their sensitivity g to the shared states, and their expected deviation [N].

        Parameters
        ----------
        measured : ndarray of float64, shape [taxels]
            Measured errors of the forces [N].
        response : ndarray of float64, shape [taxels, shared]
            Responses h of the measurements to the shared states.
        noise : ndarray of float64, shape [taxels]
            Variance R of each measurement [N2].
        """
        b = self.belief
        sensitivity = response + b.slope[:, 0] + b.slope[:, 2]
        variance = b.own_variance() + noise + self.shared_variance(sensitivity)
        return measured - self.predicted(response) - b.error[:, 2], sensitivity, np.sqrt(variance)

    def post_fit(self, updated: Mask, measured: Array, response: Array, noise: Array, unmodelled: Array) -> Array:
        """Return what is left of residuals after an update, in units of its expected deviation [1], shape [taxels].

        What all taxels share is gone then, of which each residual had more than of its own.

        Parameters
        ----------
        updated : ndarray of bool, shape [taxels]
            Taxels that were updated by these residuals.
        measured, response, noise
            As for `innovation`.
        unmodelled : ndarray of float64, shape [taxels]
            Variances of what the filter knows nothing of [N2].
        """
        alone = self.belief.own_variance()
        variance = np.where(updated, np.maximum(noise - alone, ROUNDING * noise), noise + alone)
        left: Array = (measured - self.predicted(response) - self.belief.error[:, 2]) / np.sqrt(variance + unmodelled)
        return left

    def shared_variance(self, sensitivity: Array) -> Array:
        """Return the variance that the shared states give to residuals of a sensitivity g [N2], shape [taxels]."""
        variance: Array = np.einsum("ij,ij->i", sensitivity @ self.belief.covariance, sensitivity)
        return variance

    def predicted(self, response: Array) -> Array:
        """Return the errors of the forces for given responses to the shared states [N], shape [taxels]."""
        b = self.belief
        predicted: Array = b.error[:, 0] + response @ b.shared
        return predicted

    def update(self, where: Mask, residual: Array, sensitivity: Array, noise: Array) -> None:
        """Update by the residuals of the masked taxels.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Measured taxels.
        residual : ndarray of float64, shape [taxels]
            Residuals as from `innovation` [N].
        sensitivity : ndarray of float64, shape [taxels, shared]
            Their sensitivities g.
        noise : ndarray of float64, shape [taxels]
            Variance R of each measurement [N2].
        """
        b = self.belief
        own = b.own[:, :, 0] + b.own[:, :, 2]
        total = own[:, 0] + own[:, 2] + noise
        weight = where / total
        weighted = sensitivity * weight[:, None]
        # S+ = L (I + L'JL)^-1 L' with S = LL' and the information J: stays positive.
        root = self._covariance_root()
        seen = np.sqrt(weight)[:, None] * (sensitivity @ root)
        information = seen.T @ seen
        information.reshape(-1)[:: len(root) + 1] += 1.0
        self._root = root @ np.linalg.inv(np.linalg.cholesky(information)).T
        b.covariance = self._rooted = self._root @ self._root.T
        change = b.covariance @ (weighted.T @ residual)
        b.shared = b.shared + change
        b.error += b.slope @ change
        self._update_own(weight, own, residual - sensitivity @ change, sensitivity)

    def update_alone(self, where: Mask, residual: Array, sensitivity: Array, noise: Array) -> None:
        """Update the masked taxels by residuals that tell nothing of the shared states; arguments as for `update`."""
        own = self.belief.own[:, :, 0] + self.belief.own[:, :, 2]
        self._update_own(where / (own[:, 0] + own[:, 2] + noise), own, residual, sensitivity)

    def _update_own(self, weight: Array, own: Array, residual: Array, sensitivity: Array) -> None:
        """Update the taxels' errors given the shared states, by their covariances with the residuals [N2]."""
        b, gain = self.belief, own * weight[:, None]
        b.error += gain * residual[:, None]
        b.slope -= gain[:, :, None] * sensitivity[:, None, :]
        b.own -= gain[:, :, None] * own[:, None, :]

    def temperature_innovation(self, reading: float, variance: float, leaked_time: float) -> tuple[float, Array, float]:
        """Return the innovation of a reading [K], its covariance with the shared states, and its variance [K2].

        Parameters
        ----------
        reading : float
            Mean change of the sensors since the start [K].
        variance : float
            Variance of its noise [K2].
        leaked_time : float
            Time since the temperatures were zero, as one with the leak rates of the calibration [s].
        """
        sensitivity = self._reading_sensitivity(leaked_time)
        column = self.belief.covariance @ sensitivity
        expected = (1.0 + self.belief.shared[Shared.SCALE]) * sensitivity[Shared.SCALE]
        return float(reading - expected), column, float(sensitivity @ column) + variance

    def _reading_sensitivity(self, leaked_time: float) -> Array:
        """Return the derivatives of a reading, (1 + scale) (S + zero + U0 t'), with respect to the shared states."""
        shared = self.belief.shared
        sensitivity = np.zeros(len(shared))
        sensitivity[[Shared.SENSOR, Shared.ZERO]] = 1.0 + shared[Shared.SCALE]
        sensitivity[Shared.EARLIER] = sensitivity[Shared.SENSOR] * leaked_time
        sensitivity[Shared.SCALE] = shared[Shared.SENSOR] + shared[Shared.EARLIER] * leaked_time + shared[Shared.ZERO]
        return sensitivity

    def measure_temperature(self, reading: float, variance: float, leaked_time: float) -> None:
        """Update by a reading of the temperature sensors.

        Parameters
        ----------
        reading : float
            Mean change of the sensors since the start [K].
        variance : float
            Variance of its noise [K2].
        leaked_time : float
            Time since the temperatures were zero, as one with the leak rates of the calibration [s].
        """
        innovation = self.temperature_innovation(reading, variance, leaked_time)[0]
        self.measure_shared(innovation, self._reading_sensitivity(leaked_time), variance)

    def measure_shared(self, innovation: float, sensitivity: Array, variance: float) -> None:
        """Update by a measurement of the shared states alone.

        Parameters
        ----------
        innovation : float
            Measured less expected value.
        sensitivity : ndarray of float64, shape [shared]
            Sensitivity of the measurement to the shared states.
        variance : float
            Variance of its noise.
        """
        b = self.belief
        column = b.covariance @ sensitivity
        gain = column / (float(sensitivity @ column) + variance)
        kept = np.eye(len(gain)) - np.outer(gain, sensitivity)
        change = gain * innovation
        b.shared = b.shared + change
        b.error += b.slope @ change
        # The form of Joseph, which stays positive.
        b.covariance = kept @ b.covariance @ kept.T + variance * np.outer(gain, gain)

    def restart_temperature(self, reading: float, shared: Array, covariance: Array) -> None:
        """Forget the temperatures, but for a reading of the sensors, after a time that is unknown.

        Film, chip and sensors have that temperature; their other states are as unknown as at the start.

        Parameters
        ----------
        reading : float
            Mean change of the sensors since the start [K].
        shared : ndarray of float64, shape [shared]
            Shared states at the start.
        covariance : ndarray of float64, shape [shared, shared]
            Their covariance.
        """
        b = self.belief
        b.own += b.slope @ b.covariance @ b.slope.transpose(0, 2, 1)
        b.slope[:] = 0.0
        again = list(range(Shared.ZERO + 1))
        b.shared[again] = shared[again]
        b.covariance = b.covariance.copy()
        b.covariance[again] = b.covariance[:, again] = 0.0
        b.covariance[np.ix_(again, again)] = covariance[np.ix_(again, again)]
        b.shared[[Shared.CHIP, Shared.FILM, Shared.SENSOR]] = reading

    def covariance_root(self, response: Array) -> tuple[Array, Array]:
        """Return the own variance of each force error [N2] and a factor of what they share [N].

        The covariance of the forces is ``diag(own) + factor @ factor.T``.

        Parameters
        ----------
        response : ndarray of float64, shape [taxels, shared]
            Responses h of the force errors to the shared states.
        """
        b = self.belief
        factor = (response + b.slope[:, 0]) @ self._covariance_root()
        return np.maximum(b.own[:, 0, 0], 0.0), factor
