# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Piezo- and pyroelectric charge of the film with charge leakage: exact propagation over any step, and its inverse.

The charge density sigma [C/m2] at the gate follows

    d(sigma)/dt = dq/dt - sigma/tau,    q = d33*T3 + p*dTheta

with the stress T3 [Pa] along the poling axis (compression is negative), the piezoelectric coefficient d33 [C/N], the
pyroelectric coefficient p [C/(m2 K)], the temperature change dTheta [K] and the leakage time constant tau [s].
q is called the *source*: the charge density of a film without leakage. Leakage makes sigma/q a first-order high pass.
The equation is linear, so a step is propagated by its exponential solution: a step of any length is stable and, for a
source of the stated waveform, exact to rounding.

Arrays of any shapes that broadcast together are accepted. float32 arrays stay float32 when combined with scalars,
steps and time constants of any type; anything else gives float64. All-scalar input gives a NumPy scalar.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.first_order import mean_decay
from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, real_array
from posfet_model.device.constants import VACUUM_PERMITTIVITY

STEP_RANGE: Final = (1e-12, 1e9)
"""Accepted time steps [s]."""

TIME_CONSTANT_RANGE: Final = (1e-12, 1e15)
"""Accepted leakage time constants [s]; step/time_constant then stays within float32."""

CHARGE_LIMIT: Final = 1e12
"""Largest accepted magnitude of a charge density [C/m2], far above any film, far below overflow of float32."""

STRESS_LIMIT: Final = 1e16
"""Largest accepted magnitude of a stress [Pa]: 1e4 N on 1 um2."""

_EXACT_DIFFERENCE_BELOW = 0.5


def source_charge(
    stress: ArrayLike,
    temperature_change: ArrayLike,
    piezoelectric_coefficient: ArrayLike,
    pyroelectric_coefficient: ArrayLike,
) -> FloatArray:
    """Return the charge density q [C/m2] of a film without leakage: ``q = d33*T3 + p*dTheta``.

    The direct piezoelectric effect of eq. (1) at zero field, and the pyroelectric effect.

    Parameters
    ----------
    stress : array_like
        T3 [Pa], tension positive, within +-1e16.
    temperature_change : array_like
        dTheta [K] relative to the temperature at which q is zero, within +-500.
    piezoelectric_coefficient : array_like
        d33 [C/N], within +-1e-6 (PVDF-TrFE: -38e-12).
    pyroelectric_coefficient : array_like
        p [C/(m2 K)], within +-0.1 (PVDF-TrFE: -40e-6).

    Returns
    -------
    ndarray
        q [C/m2], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper has no pyroelectric term. In PVDF and its copolymers d33 and p have the same sign: compression (T3 < 0)
    raises the charge; heating lowers it, because it lowers the polarisation. Tables often give magnitudes only.

    Examples
    --------
    A force of 1 N on 1 mm2 and a temperature rise of 1 K give about the same charge, of opposite sign:

    >>> print(f"{source_charge(-1e6, 0.0, -38e-12, -40e-6):.3g}, {source_charge(0.0, 1.0, -38e-12, -40e-6):.3g}")
    3.8e-05, -4e-05
    """
    stress, temperature_change, piezoelectric_coefficient, pyroelectric_coefficient = common_dtype(
        stress=real_array("stress", stress, -STRESS_LIMIT, STRESS_LIMIT),
        temperature_change=real_array("temperature_change", temperature_change, -500, 500),
        piezoelectric_coefficient=real_array("piezoelectric_coefficient", piezoelectric_coefficient, -1e-6, 1e-6),
        pyroelectric_coefficient=real_array("pyroelectric_coefficient", pyroelectric_coefficient, -0.1, 0.1),
    )
    return piezoelectric_coefficient * stress + pyroelectric_coefficient * temperature_change


def electric_displacement(
    stress: ArrayLike, field: ArrayLike, piezoelectric_coefficient: ArrayLike, relative_permittivity: ArrayLike
) -> FloatArray:
    """Return D3 [C/m2] of the poled film: ``D3 = d33*T3 + eps33*E3``, eq. (1).

    Parameters
    ----------
    stress : array_like
        T3 [Pa], tension positive, within +-1e16.
    field : array_like
        E3 [V/m], within +-1e12.
    piezoelectric_coefficient : array_like
        d33 [C/N], within +-1e-6.
    relative_permittivity : array_like
        eps33/eps0 [1], in [1, 1e5].

    Returns
    -------
    ndarray
        D3 [C/m2], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper prints T3 in both terms; the second one is the field E3. The printed form is in
    `posfet_model.device.as_printed`.
    """
    stress, field, piezoelectric_coefficient, relative_permittivity = common_dtype(
        stress=real_array("stress", stress, -STRESS_LIMIT, STRESS_LIMIT),
        field=real_array("field", field, -1e12, 1e12),
        piezoelectric_coefficient=real_array("piezoelectric_coefficient", piezoelectric_coefficient, -1e-6, 1e-6),
        relative_permittivity=real_array("relative_permittivity", relative_permittivity, 1, 1e5),
    )
    return piezoelectric_coefficient * stress + relative_permittivity * VACUUM_PERMITTIVITY * field


def propagate_first_order_hold(
    charge: ArrayLike, source_start: ArrayLike, source_end: ArrayLike, step: ArrayLike, time_constant: ArrayLike
) -> FloatArray:
    """Return the charge density [C/m2] one step later, the source varying linearly over the step (first-order hold).

    ``sigma1 = sigma0*exp(-h/tau) + (q1 - q0)*(1 - exp(-h/tau))/(h/tau)``

    Parameters
    ----------
    charge : array_like
        sigma0 [C/m2] at the start of the step, within +-1e12.
    source_start, source_end : array_like
        q0, q1 [C/m2] at the ends of the step, within +-1e12.
    step : array_like
        h [s], in [1e-12, 1e9].
    time_constant : array_like
        tau [s], in [1e-12, 1e15].

    Returns
    -------
    ndarray
        sigma1 [C/m2], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    Exact for a piecewise linear source. The rounding error is at most 4 units in the last place of sigma0 and 6 of q0
    and q1 (elementary functions accurate to 2 units) for h/tau from 1e-18 to 1e12, verified against a 40-digit table.

    Examples
    --------
    >>> print(f"{propagate_first_order_hold(0.0, 0.0, 1e-5, 0.01, 0.27):.6g}")
    9.81708e-06
    """
    charge, source_start, source_end = _charges(charge=charge, source_start=source_start, source_end=source_end)
    ratio = _step_ratio(charge.shape, step, time_constant)
    decay = np.exp(-ratio).astype(charge.dtype)
    return charge * decay + (source_end - source_start) * mean_decay(ratio).astype(charge.dtype)


def propagate_step(
    charge: ArrayLike, source_start: ArrayLike, source_end: ArrayLike, step: ArrayLike, time_constant: ArrayLike
) -> FloatArray:
    """Return the charge density [C/m2] one step later, the source jumping at the start of the step (zero-order hold).

    ``sigma1 = (sigma0 + q1 - q0)*exp(-h/tau)``

    Parameters
    ----------
    charge : array_like
        sigma0 [C/m2] at the start of the step, within +-1e12.
    source_start, source_end : array_like
        q0, q1 [C/m2] before and after the jump, within +-1e12.
    step : array_like
        h [s], in [1e-12, 1e9].
    time_constant : array_like
        tau [s], in [1e-12, 1e15].

    Returns
    -------
    ndarray
        sigma1 [C/m2], of the broadcast shape; rounding as in `propagate_first_order_hold`.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    For a smooth source sampled at the ends of the step this hold is early by half a step; it is meant for sources that
    jump.
    """
    charge, source_start, source_end = _charges(charge=charge, source_start=source_start, source_end=source_end)
    decay = np.exp(-_step_ratio(charge.shape, step, time_constant)).astype(charge.dtype)
    return (charge + (source_end - source_start)) * decay


def invert_first_order_hold(
    charge_start: ArrayLike, charge_end: ArrayLike, step: ArrayLike, time_constant: ArrayLike
) -> FloatArray:
    """Return the change q1 - q0 [C/m2] of the source that changed the charge density from sigma0 to sigma1 in one step.

    The exact inverse of `propagate_first_order_hold`, the leakage compensation:
    ``q1 - q0 = (sigma1 - sigma0*exp(-h/tau))*(h/tau)/(1 - exp(-h/tau))``

    Parameters
    ----------
    charge_start, charge_end : array_like
        sigma0, sigma1 [C/m2], within +-1e12.
    step : array_like
        h [s], in [1e-12, 1e9].
    time_constant : array_like
        tau [s], in [1e-12, 1e15].

    Returns
    -------
    ndarray
        q1 - q0 [C/m2], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    An error e of sigma1 causes an error ``e*(h/tau)/(1 - exp(-h/tau))``: unchanged for short steps, amplified by h/tau
    for long ones, where the charge retains almost nothing of the source.
    """
    charge_start, charge_end = _charges(charge_start=charge_start, charge_end=charge_end)
    ratio = _step_ratio(charge_start.shape, step, time_constant)
    dtype = charge_start.dtype
    # Short steps: sigma1 - sigma0 is exact and the leaked part is small. Long steps: the remaining part is small.
    leaked = charge_start * np.expm1(-ratio).astype(dtype)
    remaining = charge_start * np.exp(-ratio).astype(dtype)
    change = np.where(ratio < _EXACT_DIFFERENCE_BELOW, (charge_end - charge_start) - leaked, charge_end - remaining)
    return change / mean_decay(ratio).astype(dtype)


def frequency_response(frequency: ArrayLike, time_constant: ArrayLike) -> NDArray[np.complexfloating[Any, Any]]:
    """Return sigma/q, the complex response of the charge to a sinusoidal source: a first-order high pass.

    ``H(f) = j*2*pi*f*tau/(1 + j*2*pi*f*tau)``; -3 dB at ``1/(2*pi*tau)``.

    Parameters
    ----------
    frequency : array_like
        f [Hz], in [0, 1e15].
    time_constant : array_like
        tau [s], in [1e-12, 1e15].

    Returns
    -------
    ndarray
        sigma/q [1], complex, of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Examples
    --------
    >>> print(f"{abs(frequency_response(1 / (2 * math.pi * 0.27), 0.27)):.12f}")
    0.707106781187
    """
    frequency, time_constant = common_dtype(
        frequency=real_array("frequency", frequency, 0, 1e15),
        time_constant=real_array("time_constant", time_constant, *TIME_CONSTANT_RANGE),
    )
    turn = 1j * (2 * math.pi * frequency * time_constant)
    return turn / (1 + turn)


def step_response(time: ArrayLike, time_constant: ArrayLike) -> FloatArray:
    """Return sigma/q after a unit step of the source at time 0: ``exp(-t/tau)``.

    Parameters
    ----------
    time : array_like
        t [s], in [0, 1e9].
    time_constant : array_like
        tau [s], in [1e-12, 1e15].

    Returns
    -------
    ndarray
        sigma/q [1], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    time, time_constant = common_dtype(
        time=real_array("time", time, 0, STEP_RANGE[1]),
        time_constant=real_array("time_constant", time_constant, *TIME_CONSTANT_RANGE),
    )
    return np.exp(-time / time_constant)


def _charges(**charges: ArrayLike) -> tuple[FloatArray, ...]:
    """Check charge densities and return them with a common dtype and shape."""
    checked = {name: real_array(name, value, -CHARGE_LIMIT, CHARGE_LIMIT) for name, value in charges.items()}
    return tuple(np.broadcast_arrays(*common_dtype(**checked)))


def _step_ratio(shape: tuple[int, ...], step: ArrayLike, time_constant: ArrayLike) -> FloatArray:
    """Return h/tau in float64, after checking its shape against that of the charges."""
    step = real_array("step", step, *STEP_RANGE)
    time_constant = real_array("time_constant", time_constant, *TIME_CONSTANT_RANGE)
    common_dtype(step=step, time_constant=time_constant, charge=np.empty(shape))
    return step.astype(np.float64) / time_constant.astype(np.float64)
