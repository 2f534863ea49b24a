# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Threshold voltage and gain factor from a measured transfer curve, by the two standard extrapolation methods.

Both fit a straight line by least squares and then check that the points used lie in the region for which the line is
valid. Review of such methods: A. Ortiz-Conde et al., Microelectron. Reliab. 42, 583, 2002,
doi:10.1016/S0026-2714(02)00027-6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.validation import real_array, real_number
from posfet_model.device.transistor import CURRENT_LIMIT, VOLTAGE_LIMIT

_SLACK = 1e-9
"""Tolerance at the edge of a region, relative to the drain voltage [1], for rounding and a little measurement noise."""


@dataclass(frozen=True)
class ThresholdFit:
    """Result of an extrapolation: Vth [V], beta*(1 + lambda*Vds) [A/V2], number of points used."""

    threshold_voltage: float
    gain_factor: float
    points: int


def fit_saturation_curve(
    gate_voltage: ArrayLike, drain_current: ArrayLike, drain_voltage: float, lowest_share: float = 0.1
) -> ThresholdFit:
    """Fit ``sqrt(Id) = sqrt(beta/2)*(Vgs - Vth)``, eq. (10), to a transfer curve measured in saturation.

    Parameters
    ----------
    gate_voltage : array_like
        Vgs [V], shape (n,), n >= 2, within +-1e6, in any order.
    drain_current : array_like
        Id [A], shape (n,), within +-1e6; negative readings are excluded with the small ones.
    drain_voltage : float
        Vds [V] of the whole curve, in (0, 1e6]; the transistor is saturated up to Vgs = Vth + Vds.
    lowest_share : float, default 0.1
        Points below this fraction of the largest current are excluded [1], in (0, 1).

    Returns
    -------
    ThresholdFit
        Threshold voltage, gain factor and number of points.

    Raises
    ------
    ValueError
        An argument is invalid, fewer than two gate voltages remain, the current does not rise with the gate voltage, or
        the points used were not in saturation.

    Examples
    --------
    >>> fit = fit_saturation_curve([0, 1.0, 1.5, 2.0], [0, 4.5e-5, 3.2e-4, 8.45e-4], 5.0)
    >>> print(f"{fit.threshold_voltage:.6f} {fit.gain_factor:.6f} {fit.points}")
    0.700000 0.001000 2
    """
    gate, current, drain = _measured(gate_voltage, drain_current, drain_voltage)
    gate, current = _above_fraction(gate, current, lowest_share)
    slope, crossing = _fit_line(gate, np.sqrt(current))
    if gate.max() - crossing > drain * (1 + _SLACK):
        raise ValueError(
            f"gate_voltage must be in [{crossing:g}, {crossing + drain:g}] to saturate, got {gate.max():g}"
        )
    return ThresholdFit(crossing, 2 * slope**2, gate.size)


def fit_linear_curve(
    gate_voltage: ArrayLike, drain_current: ArrayLike, drain_voltage: float, lowest_share: float = 0.5
) -> ThresholdFit:
    """Fit ``Id = beta*Vds*(Vgs - Vth - Vds/2)``, eq. (9), to a transfer curve measured at a small drain voltage.

    Parameters
    ----------
    gate_voltage : array_like
        Vgs [V], shape (n,), n >= 2, within +-1e6, in any order; those used must be at least Vth + Vds.
    drain_current : array_like
        Id [A], shape (n,), within +-1e6; negative readings are excluded with the small ones.
    drain_voltage : float
        Vds [V] of the whole curve, in (0, 1e6].
    lowest_share : float, default 0.5
        Points below this fraction of the largest current are excluded [1], in (0, 1).

    Returns
    -------
    ThresholdFit
        Threshold voltage, gain factor and number of points.

    Raises
    ------
    ValueError
        An argument is invalid, fewer than two gate voltages remain, the current does not rise with the gate voltage, or
        the points used were not in the linear region.

    Examples
    --------
    >>> fit = fit_linear_curve([0, 1.0, 1.5, 2.0], [0, 2.5e-5, 7.5e-5, 1.25e-4], 0.1)
    >>> print(f"{fit.threshold_voltage:.6f} {fit.gain_factor:.6f} {fit.points}")
    0.700000 0.001000 2
    """
    gate, current, drain = _measured(gate_voltage, drain_current, drain_voltage)
    gate, current = _above_fraction(gate, current, lowest_share)
    slope, crossing = _fit_line(gate, current)
    threshold = crossing - drain / 2
    if gate.min() - threshold < drain * (1 - _SLACK):
        raise ValueError(
            f"gate_voltage must be at least {threshold + drain:g} for the linear region, got {gate.min():g}"
        )
    return ThresholdFit(threshold, slope / drain, gate.size)


def _measured(
    gate_voltage: ArrayLike, drain_current: ArrayLike, drain_voltage: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    gate = real_array("gate_voltage", gate_voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT).astype(np.float64)
    current = real_array("drain_current", drain_current, -CURRENT_LIMIT, CURRENT_LIMIT).astype(np.float64)
    if gate.ndim != 1 or gate.shape != current.shape:
        raise ValueError(f"gate_voltage and drain_current must be of shape (n,), got {gate.shape} and {current.shape}")
    return gate, current, real_number("drain_voltage", drain_voltage, 1e-9, VOLTAGE_LIMIT)


def _above_fraction(
    gate: NDArray[np.float64], current: NDArray[np.float64], lowest_share: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of at least the given fraction of the largest current."""
    share = real_number("lowest_share", lowest_share, 0, 1, exclusive=True)
    largest = current.max(initial=0)
    if current.size and not largest > 0:
        raise ValueError("drain_current must rise above 0, got none that does")
    used = current >= share * largest
    return gate[used], current[used]


def _fit_line(gate: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the least-squares slope of the values, and the gate voltage at which the line crosses zero."""
    if np.unique(gate).size < 2:
        raise ValueError(f"gate_voltage must have two different values or more to fit, got {gate}")
    centred = gate - gate.mean()
    slope = float(centred @ values / (centred @ centred))
    if slope <= 0:
        raise ValueError(f"drain_current must rise with the gate voltage, got a slope of {slope:g}")
    return slope, float(gate.mean() - values.mean() / slope)
