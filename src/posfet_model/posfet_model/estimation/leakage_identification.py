# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Leakage time constants, estimated online.

The observer integrates with tau' instead of the true tau, and so gives F' instead of the force F. As F' is the
remaining charge x plus tau/tau' times the true leakage,

    F' = x + (tau/tau')*(F - x) = (1 - b)*F + b*x,    b = 1 - tau/tau'

While a force is held, or changes at a constant rate, F' follows the decay of x with the slope b, which a linear trend
does not explain. So means over blocks, in windows of about one time constant, are fitted by ``F' = a + c*t + b*x``.
Windows whose residuals exceed the noise are rejected, and so are taxels that contradict the others.

Taxels have an error of the description in common (temperature of the bias resistors, for example), and each has an
individual error. With theta = ln(tau/tau described), an estimate on one taxel carries over to the others as far as
their error is common.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import upper_median
from posfet_model._lib.types import Array, Mask

POINTS: Final = 24
"""Greatest number of blocks in a window."""

LEAST_POINTS: Final = 8
"""Least number of blocks in a window."""

HOP: Final = 0.25
"""Distance between the starts of two windows, as a share of a window [1]."""

MISFIT: Final = 2.0
"""Mean square residual above which a fit is rejected, in variances of its points [1]."""

MODEL_ERROR: Final = 2e-3
"""Residual that a fit may have in addition, as a share of the change of the charge [1]."""

LARGEST_TREND: Final = 0.015
"""Relative change of the force in a window above which a fit is rejected [1]: the change may be nonlinear, too."""

INFORMATIVE: Final = 0.03
"""Standard deviation of b above which a fit is not informative [1]."""

LARGEST_SLOPE: Final = 0.4
"""A |b| above this has another cause [1]."""

CREEP: Final = 0.02
"""Greatest error of b due to creep of the force, common to all taxels: standard deviation [1], assumed."""

FEW_TAXELS_ERROR: Final = 0.05
"""Error of b due to a changing force where few taxels are informative: standard deviation times their number [1],
assumed."""

OUTLIER: Final = 3.0
"""Standard deviations by which an estimate may differ from that taxel's previous one, and from the others in its window
[1]."""

WINDOWS: Final = 4.0
"""Effective number of windows that are averaged, where each has the standard deviation `CREEP` of b [1]."""


class LeakageIdentifier:
    """Estimates theta of all taxels, and from it their leakage time constants.

    State variables: theta [1] and its weight for each taxel, standard deviations of its common and individual parts
    [1], accumulated leakage [N] since the touch began, and a ring buffer of block means.

    Parameters
    ----------
    time_constant : ndarray of float64, shape [taxels]
        Described time constants [s].
    noise_variance : ndarray of float64, shape [taxels]
        Variance of a reading [N2]; not copied.
    common : float
        Standard deviation of the common part of theta [1].
    individual : float
        Standard deviation of the individual part of theta [1].
    """

    def __init__(self, time_constant: Array, noise_variance: Array, common: float, individual: float) -> None:
        taxels = len(time_constant)
        self.time_constant = time_constant.copy()
        """Estimated time constants [s]; changed in place by `update`."""
        self.individual_deviation = np.full(taxels, individual)
        """Standard deviation of the individual part of theta [1]."""
        self.common_deviation = common
        """Standard deviation of the common part of theta [1]."""
        self.variance = np.zeros(taxels)
        """Variance of each force due to theta, the common part included [N2]."""
        self.correlated_error = np.zeros(taxels)
        """Error of each force for one standard deviation of the common part [N]."""
        self._leaked = np.zeros(taxels)
        self._base = np.zeros(taxels)
        self._described = time_constant
        self._common_prior = common
        self._individual_prior = individual
        self._noise_variance = noise_variance
        self._theta = np.zeros(taxels)
        self._weight = np.zeros(taxels)
        self._weighted = np.zeros(taxels)
        self._typical = upper_median(time_constant)
        self._force = np.zeros((POINTS, taxels))
        self._charge = np.zeros((POINTS, taxels))
        self._durations = np.zeros(POINTS)
        self._touched = np.zeros(taxels, np.intp)  # number of consecutive blocks
        self._next = 0
        self._since = 0.0
        self._new_estimate = False

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the mean theta [1]."""
        return math.hypot(self.common_deviation, float(self.individual_deviation.mean()))

    def restart_window(self) -> None:
        """Start a new window."""
        self._touched[:] = 0

    def begin_touch(self, where: Mask, leaked: Array) -> None:
        """Record that a touch begins on the masked taxels, with the accumulated leakage so far [N].

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels concerned.
        leaked : ndarray of float64, shape [taxels]
            Accumulated leakage [N].
        """
        self._base[where] = leaked[where]

    def end_touch(self) -> None:
        """Record that nothing touches."""
        self.variance[:] = self.correlated_error[:] = 0.0

    def add_block(self, duration: float, scans: int, force: Array, leaked: Array, touched: Mask) -> None:
        """Add a block to the window, and fit the window when it is due.

        Parameters
        ----------
        duration : float
            Duration of the block [s].
        scans : int
            Number of its scans.
        force : ndarray of float64, shape [taxels]
            Mean forces of the block [N].
        leaked : ndarray of float64, shape [taxels]
            Accumulated leakage up to its end, as a force, up to a constant [N].
        touched : ndarray of bool, shape [taxels]
            Taxels touched during the whole block.
        """
        self._force[self._next] = force
        # The leakage over a block gives the mean of the charge in it.
        np.multiply(leaked - self._leaked, self.time_constant / duration, out=self._charge[self._next])
        self._leaked = leaked
        self._durations[self._next] = duration
        self._next = (self._next + 1) % POINTS
        self._touched += 1
        self._touched *= touched
        self._since += duration
        points = min(max(math.ceil(self._typical / duration), LEAST_POINTS), POINTS)
        if self._since >= HOP * points * duration:
            complete = self._touched >= points
            if complete.any():
                self._since = 0.0
                self._fit(complete.nonzero()[0], points, scans)

    def update(self, touched: Mask, observed: Array) -> Array | None:
        """Update the time constants and the variance of the forces under a touch.

        Parameters
        ----------
        touched : ndarray of bool, shape [taxels]
            Touched taxels.
        observed : ndarray of float64, shape [taxels]
            Leakage since each touch began that is known apart from the individual part of theta [N].

        Returns
        -------
        ndarray of float64, shape [taxels], or None
            Change of the forces due to the new time constants [N]; None: no new estimate.
        """
        change = self._update_time_constants(touched) if self._new_estimate else None
        leaked = np.where(touched, self._leaked - self._base, 0.0)
        np.multiply(np.where(touched, leaked - observed, 0.0), self.common_deviation, out=self.correlated_error)
        np.multiply(leaked, self.individual_deviation, out=self.variance)
        self.variance *= self.variance
        self.variance += self.correlated_error**2
        return change

    def _update_time_constants(self, touched: Mask) -> Array:
        self._new_estimate = False
        individual, common_prior = self._individual_prior**2, self._common_prior**2
        seen = self._weight > 0.0
        precision = 1.0 / (individual + 1.0 / self._weight[seen])
        total = 1.0 / common_prior + precision.sum()
        common = float((precision * self._weighted[seen] / self._weight[seen]).sum()) / total
        theta = (common / individual + self._weighted) / (1.0 / individual + self._weight)
        self.common_deviation = math.sqrt(1.0 / total)
        np.sqrt(1.0 / (1.0 / individual + self._weight), out=self.individual_deviation)
        change: Array = np.where(touched, (self._leaked - self._base) * np.expm1(self._theta - theta), 0.0)
        self._theta = theta
        np.multiply(self._described, np.exp(theta), out=self.time_constant)
        self._leaked = self._leaked + change
        self.restart_window()
        return change

    def _fit(self, taxels: NDArray[np.intp], points: int, scans: int) -> None:
        """Fit the last points, means over `scans` each, of some taxels."""
        rows = np.arange(self._next - points, self._next) % POINTS
        durations = self._durations[rows]
        time = np.cumsum(durations) - 0.5 * durations
        time -= time.mean()
        noise = self._noise_variance[taxels] / scans
        window = self._charge[np.ix_(rows, taxels)]
        charge, charge_rate = _detrended(time, window)
        # Means of force and charge have the same noise, which by itself would give a slope of 1.
        square = np.einsum("ij,ij->j", charge, charge) - (points - 2) * noise
        informative = square > noise / INFORMATIVE**2
        if not informative.any():
            return
        taxels, noise, square = taxels[informative], noise[informative], square[informative]
        charge, charge_rate = charge[:, informative], charge_rate[informative]
        window = self._force[np.ix_(rows, taxels)]
        force, force_rate = _detrended(time, window)
        slope = (np.einsum("ij,ij->j", charge, force) - (points - 2) * noise) / square
        residual = np.square(force - slope * charge).sum(axis=0) / (points - 3)
        good = residual <= MISFIT * noise * (1.0 - slope) ** 2 + (MODEL_ERROR**2 / points) * square
        moved = np.abs(force_rate - slope * charge_rate) * durations.sum()
        good &= (np.abs(slope) < LARGEST_SLOPE) & (moved <= LARGEST_TREND * window.mean(axis=0))
        if good.any():
            self._combine(taxels[good], slope[good], (noise / square)[good])

    def _combine(self, taxels: NDArray[np.intp], slope: Array, variance: Array) -> None:
        """Combine the slopes b of some taxels, with the variance due to their noise, with earlier estimates."""
        count = len(taxels)
        variance = variance + count * CREEP**2 + (FEW_TAXELS_ERROR / count) ** 2
        found = self._theta[taxels] + np.log1p(-slope)
        median = upper_median(found)
        consistent = np.abs(found - median) <= OUTLIER * np.sqrt(variance + self._individual_prior**2)
        expected = variance + self.individual_deviation[taxels] ** 2 + self.common_deviation**2
        consistent &= np.abs(found - self._theta[taxels]) <= OUTLIER * np.sqrt(expected)
        if 2 * np.count_nonzero(consistent) <= count:
            return
        # Overlapping windows have most of their blocks in common.
        taxels, found, weight = taxels[consistent], found[consistent], HOP / variance[consistent]
        # The weight is limited to a few windows, so that slow changes are followed.
        kept = np.minimum(1.0, WINDOWS / (CREEP**2 * np.maximum(self._weight[taxels], 1.0)))
        self._weight[taxels] = kept * self._weight[taxels] + weight
        self._weighted[taxels] = kept * self._weighted[taxels] + weight * found
        self._new_estimate = True


def _detrended(time: Array, values: Array) -> tuple[Array, Array]:
    """Return values, shape [points, n], without their linear trend over time [s], and its slopes, shape [n].

    The mean of time is 0.
    """
    slope = time @ values / (time @ time)
    residual: Array = values - values.mean(axis=0) - time[:, None] * slope
    return residual, slope
