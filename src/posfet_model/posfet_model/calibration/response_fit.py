# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Joint least-squares fit of gain, hysteresis and leakage of each taxel, and of what all taxels have in common.

The charge of a taxel, as a nominal force, is

    x(t) = H[ g*(F + sum_k s_k*L_k[F] + W*q*L_w[touched]) + sum_j w_j*h_j + common ] + o + c*exp(-t/tau)

H is the leakage (high-pass of time constant tau), L a first-order lag. Of each taxel: gain g, weights w_j of the
sources h_j of its hysteresis, leakage rate 1/tau, and in each of its segments offset o and start c. Of all taxels: the
sizes s_k of the relaxation poles and the level W of the temperature rise of a touched taxel, which the film turns into
q newtons per kelvin. The common-mode signal is given. Residuals are those of the output: noise, when the model holds.

The model is linear but for 1/tau and g*s_k; each iteration is a linear fit with the derivative by 1/tau as a column and
the last g. The parameters of a taxel are eliminated from the equations of the common ones (arrow structure), so
that the cost is linear in the number of taxels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from posfet_core import scan_path
from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.leaky_response import block_means

BLOCK: Final = 0.02
"""Scans are averaged over this time [s]: a period of the mains."""

WARMTH_TIME_CONSTANTS: Final = (0.15, 0.26, 0.46, 0.8, 1.4, 2.4, 4.2)
"""Time constants with which the film of a touched taxel may warm and cool [s]: the one that fits best is taken, between
them by a parabola of the sums of squares."""

WARMTH_TIME_SPREAD: Final = 0.8
"""Standard deviation of the logarithm of that time constant about the nominal one [1], assumed."""

WARMTH_FORCES: Final = (0.0035, 0.0053, 0.008, 0.012, 0.018, 0.027, 0.04, 0.06, 0.09, 0.135, 0.2)
"""Forces at which a taxel may have 1 - 1/e of the temperature rise of a strong touch [N]: found likewise."""

WARMTH_FORCE_SPREAD: Final = 1.0
"""Standard deviation of the logarithm of that force about the nominal one [1], assumed."""

WARMTH_STEEPNESSES: Final = (2.0, 4.0, 8.0)
"""How abruptly the temperature rise may become whole with the force, in place of 1 [1]: tried in this order, as long as
each fits better than the one before."""

ITERATIONS: Final = 4
"""Iterations of the fit; the first finds gain and offset with the given leakage."""

RATE_RANGE: Final = (0.1, 10.0)
"""Range in which the fit looks for the leakage rate, relative to nominal [1]."""


@dataclass(frozen=True, eq=False)
class Segment:
    """Consecutive scans of one taxel."""

    taxel: int
    time: Array
    """[s], shape [scans]."""
    signal: Array
    """Charge as a nominal force [N], common-mode signal subtracted, shape [scans]."""
    sources: Array
    """Sources [N]: force, those of hysteresis, and further ones, shape [scans, sources]; those after the first
    `leaking` ones are signals, which have leaked already."""
    common_sources: Array
    """Sources per gain and common parameter: ``L_k[F]`` [N], then ``q*L_w[touched]`` [N/K], shape [scans, common]."""
    fitted: Mask
    """Blocks that are fitted; the others belong to the hold-out set, shape [blocks]."""
    leaking: int | None = None
    """Number of sources that leak; None: all."""

    @cached_property
    def block(self) -> int:
        """Number of scans in a block."""
        return block_size(self.time)

    @cached_property
    def signal_means(self) -> Array:
        """Means of the signal [N], shape [blocks]."""
        return block_means(self.signal, self.block)

    @cached_property
    def all_sources(self) -> Array:
        """Sources, then common sources, shape [scans, sources + common]."""
        return np.hstack([self.sources, self.common_sources])


@dataclass(eq=False)
class TaxelResponse:
    """Parameters of one taxel."""

    rate: float
    """Leakage rate 1/tau [1/s]."""
    coefficients: Array
    """Coefficients of the sources [1]: gain, hysteresis, further ones."""
    offsets: Array
    """Offset o of each segment [N]."""
    starts: Array
    """Start c of each segment [N]."""
    deviations: Array = field(default_factory=lambda: np.zeros(0))
    """Standard deviations of the coefficients [1], then of the leakage rate [1/s]."""
    residuals: tuple[Array, ...] = ()
    """Residuals of each segment [N], shapes [blocks]."""

    @property
    def gain(self) -> float:
        """Signal per force [1]."""
        return float(self.coefficients[0])


@dataclass(eq=False)
class ResponseFit:
    """Result of the fit."""

    taxels: dict[int, TaxelResponse]
    """Parameters of each taxel."""
    common: Array
    """Sizes s_k of the poles [1], and the temperature rise W of a touched taxel [K]."""
    common_covariance: Array
    """Covariance of `common`."""

    def without_common(self, count: int) -> ResponseFit:
        """Return the fit with the first common parameters only.

        Parameters
        ----------
        count : int
            How many of them.
        """
        return ResponseFit(self.taxels, self.common[:count], self.common_covariance[:count, :count])

    def with_common_before(self, count: int) -> ResponseFit:
        """Return the fit with that many common parameters of 0 before the others.

        Parameters
        ----------
        count : int
            How many.
        """
        covariance = np.pad(self.common_covariance, ((count, 0), (count, 0)))
        return ResponseFit(self.taxels, np.append(np.zeros(count), self.common), covariance)

    def variances(self, noise: Array) -> dict[int, float]:
        """Return the variance of a block of each taxel [N2]: of noise, or of what is left, correlation included."""
        return {
            taxel: max(float(noise[taxel]) ** 2, correlated_variance(np.concatenate(each.residuals)))
            for taxel, each in self.taxels.items()
        }

    def square_sum(self, variances: dict[int, float]) -> float:
        """Return the sum of the squares of all residuals in these variances [1]."""
        return sum(
            float(np.square(np.concatenate(each.residuals)).sum()) / variances[taxel]
            for taxel, each in self.taxels.items()
        )


def fit_responses(
    segments: Sequence[Segment],
    noise: Array,
    start: dict[int, TaxelResponse],
    nominal_rate: float,
    prior: Array | None = None,
    least: Array | None = None,
) -> ResponseFit:
    """Fit all segments jointly.

    Parameters
    ----------
    segments : sequence of Segment
        Segments of every taxel that is to be fitted.
    noise : ndarray
        Standard deviation of a block mean of each taxel [N], shape [rows * cols].
    start : dict of int to TaxelResponse
        Where the fit starts, for every taxel with a segment.
    nominal_rate : float
        Nominal leakage rate [1/s].
    prior : ndarray, optional
        Prior standard deviations of the common parameters, shape [common]; None: there are none.
    least : ndarray, optional
        Least values of the common parameters, shape [common]; None: any values.

    Returns
    -------
    ResponseFit
        Parameters of the taxels and common parameters.
    """
    of_taxel: dict[int, list[Segment]] = {}
    for segment in segments:
        of_taxel.setdefault(segment.taxel, []).append(segment)
    prior = np.zeros(0) if prior is None else prior
    common: Array = np.zeros(len(prior))
    covariance = np.diag(prior**2)
    responses = dict(start)
    limits = RATE_RANGE[0] * nominal_rate, RATE_RANGE[1] * nominal_rate
    for iteration in range(ITERATIONS):
        systems = {taxel: _System(parts, responses[taxel], iteration > 0, common) for taxel, parts in of_taxel.items()}
        if len(prior):
            information, moment = np.diag(prior**-2.0), np.zeros(len(prior))
            for taxel, system in systems.items():
                variance = system.variance(noise[taxel])
                information += system.common_information / variance
                moment += system.common_moment / variance
            covariance = np.asarray(np.linalg.inv(information), np.float64)
            common = _bounded(information, moment, least) if least is not None else covariance @ moment
        responses = {taxel: system.response(common, limits) for taxel, system in systems.items()}
    for taxel, system in systems.items():
        system.complete(responses[taxel], common, covariance)
    return ResponseFit(responses, common, covariance)


def _bounded(information: Array, moment: Array, least: Array) -> Array:
    """Return the parameters of a quadratic form; those that turn out too small are set to their least values."""
    found: Array = least.copy()
    free = np.ones(len(least), np.bool_)
    while free.any():
        rest = moment[free] - information[np.ix_(free, ~free)] @ least[~free]
        found[free] = np.linalg.solve(information[np.ix_(free, free)], rest)
        if (found >= least).all():
            break
        free[np.argmin(found - least)] = False
        found[~free] = least[~free]
    return found


class _System:
    """Linear equations of one taxel in one iteration."""

    def __init__(self, parts: Sequence[Segment], at: TaxelResponse, with_rate: bool, common: Array) -> None:
        self._parts, self._at, self._with_rate = parts, at, with_rate
        tau = 1.0 / at.rate
        sources = parts[0].sources.shape[1]
        rows, self._common_rows, self._signal, self._used = [], [], [], []
        for index, part in enumerate(parts):
            leaking = sources if part.leaking is None else part.leaking
            coefficients = np.concatenate([at.coefficients, at.gain * common])
            means = scan_path.fit_columns(
                part.time, part.all_sources, tau, coefficients, at.starts[index], leaking, sources, part.block
            )
            columns = np.zeros((len(means), sources + 1 + 2 * len(parts)))
            columns[:, :sources] = means[:, :sources]
            columns[:, sources] = means[:, -2] * with_rate
            columns[:, sources + 1 + 2 * index] = 1.0
            columns[:, sources + 2 + 2 * index] = means[:, -1]
            rows.append(columns)
            self._common_rows.append(at.gain * means[:, sources:-2])
            self._signal.append(part.signal_means)
            self._used.append(part.fitted)
        self._sources, self._rows = sources, rows
        used = np.concatenate(self._used)
        self._equations = np.concatenate(rows)[used]
        # Columns of so different sizes are scaled; an empty one stays empty, and its coefficient 0.
        self._scale = np.maximum(np.sqrt((self._equations**2).mean(axis=0)), 1e-12)
        scaled = self._equations / self._scale
        inverse = np.linalg.pinv(_product(scaled, scaled), rcond=1e-13, hermitian=True)
        inverse = inverse / self._scale / self._scale[:, None]
        signal, shared = np.concatenate(self._signal)[used], np.concatenate(self._common_rows)[used]
        self._of_signal = inverse @ _product(self._equations, signal[:, None])[:, 0]
        self._of_common = inverse @ _product(self._equations, shared)
        rest = signal - self._equations @ self._of_signal
        across = shared - self._equations @ self._of_common
        self.common_information = _product(across, across)
        self.common_moment = _product(across, rest[:, None])[:, 0]
        self._rest, self._across, self._inverse = rest, across, inverse

    def variance(self, noise: float) -> float:
        """Return the variance of a block [N2], correlation included: of noise, or of what is left if that is more.

        What is left is judged with the common parameters that fit this taxel alone best.
        """
        left = self._rest
        if self._across.shape[1]:
            left = left - self._across @ np.linalg.lstsq(self._across, self._rest, rcond=1e-9)[0]
        return max(noise**2, correlated_variance(left))

    def response(self, common: Array, limits: tuple[float, float]) -> TaxelResponse:
        """Return the parameters of the taxel for given common parameters."""
        found = self._of_signal - self._of_common @ common
        sources = self._sources
        rate = self._at.rate + (float(found[sources]) if self._with_rate else 0.0)
        rate = float(np.clip(rate, 0.5 * self._at.rate, 2.0 * self._at.rate))
        return TaxelResponse(
            rate=float(np.clip(rate, *limits)),
            coefficients=found[:sources],
            offsets=found[sources + 1 :: 2],
            starts=found[sources + 2 :: 2],
        )

    def complete(self, response: TaxelResponse, common: Array, covariance: Array) -> None:
        """Add residuals and standard deviations to the parameters that were found last."""
        found = self._of_signal - self._of_common @ common
        response.residuals = tuple(
            signal - rows @ found - shared @ common
            for signal, rows, shared in zip(self._signal, self._rows, self._common_rows, strict=True)
        )
        left = np.concatenate(response.residuals)[np.concatenate(self._used)]
        own = np.diag(self._inverse) * correlated_variance(left)
        through_common = np.einsum("ij,jk,ik->i", self._of_common, covariance, self._of_common)
        response.deviations = np.sqrt(own + through_common)[: self._sources + 1]


def _product(left: Array, right: Array) -> Array:
    """Return left.T @ right; einsum, because threads cost more than they gain for so narrow matrices."""
    product: Array = np.einsum("ij,ik->jk", left, right)
    return product


def least_of_parabola(places: Sequence[float], values: Sequence[float]) -> float:
    """Return where a parabola through three values is least, in the logarithm of their places.

    Parameters
    ----------
    places : sequence of float
        Three places, ascending: the least of all values lies between them, or is that at one of the ends.
    values : sequence of float
        Value at each.
    """
    curve = np.polyfit(np.log(places), np.asarray(values) - min(values), 2)
    if curve[0] <= 0.0:
        return places[int(np.argmin(values))]
    return float(np.exp(np.clip(-0.5 * curve[1] / curve[0], *np.log([places[0], places[-1]]))))


def block_size(time: Array) -> int:
    """Return the number of scans in a block.

    Parameters
    ----------
    time : ndarray
        [s], shape [scans].
    """
    return max(1, round(BLOCK / float(np.median(np.diff(time))))) if len(time) > 1 else 1


def correlated_variance(residuals: Array) -> float:
    """Return the variance that independent residuals would need for their means to scatter as these do.

    The largest of ``n*var(means of n residuals)`` for n = 1, 2, 4, ... up to an eighth of the residuals; the variance
    of white noise is the same for every n.

    Parameters
    ----------
    residuals : ndarray
        Residuals in order of time, shape [blocks].

    Returns
    -------
    float
        Variance, in the squared unit of the residuals.
    """
    largest, count, means = 0.0, 1, residuals
    while count == 1 or count * 8 <= len(residuals):
        largest = max(largest, count * float(means @ means) / max(len(means), 1))
        pairs = len(means) // 2
        count, means = 2 * count, 0.5 * (means[: 2 * pairs : 2] + means[1 : 2 * pairs : 2])
    return largest
