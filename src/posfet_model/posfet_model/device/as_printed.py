# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The paper's formulas as printed, misprints included, for comparison with the corrected ones.

Nothing else in this package uses them. Each function has the name of the correct one; docs/errata.md has the numbers.
The arguments and their ranges are those of the correct functions, in the same units; an argument that is not a real
number or out of range is a ValueError. Only the polarisations may be swapped, as the paper does. Where a formula has no
value the result is NaN.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, instance, real_array, real_number
from posfet_model.device.charge import STRESS_LIMIT
from posfet_model.device.constants import VACUUM_PERMITTIVITY
from posfet_model.device.film import COERCIVE_FIELD_RANGE, POLARISATION_LIMIT
from posfet_model.device.mechanics import LENGTH_RANGE, MODULUS_RANGE, POISSON_RANGE, PRESSURE_LIMIT
from posfet_model.device.transistor import GAIN_FACTOR_RANGE, VOLTAGE_LIMIT, Stack

_CHARGE_LIMIT = 1e6  # as `transistor.threshold_shift`


def electric_displacement(
    stress: ArrayLike, piezoelectric_coefficient: ArrayLike, relative_permittivity: ArrayLike
) -> FloatArray:
    """Return eq. (1) as printed: ``D3 = d33*T3 + eps33*T3``.

    Correct: `posfet_model.device.charge.electric_displacement`. The second T3 should be E3: the printed sum adds
    different units.

    Parameters
    ----------
    stress : array_like
        T3 [Pa].
    piezoelectric_coefficient : array_like
        d33 [C/N].
    relative_permittivity : array_like
        eps33/eps0 [1].

    Returns
    -------
    ndarray
        D3 as printed, of the broadcast shape.
    """
    stress, piezoelectric_coefficient, relative_permittivity = common_dtype(
        stress=real_array("stress", stress, -STRESS_LIMIT, STRESS_LIMIT),
        piezoelectric_coefficient=real_array("piezoelectric_coefficient", piezoelectric_coefficient, -1e-6, 1e-6),
        relative_permittivity=real_array("relative_permittivity", relative_permittivity, 1, 1e5),
    )
    return piezoelectric_coefficient * stress + relative_permittivity * VACUUM_PERMITTIVITY * stress


def branch_steepness(coercive_field: float, remnant_polarisation: float, saturation_polarisation: float) -> float:
    """Return eq. (3) as printed, with the polarisations of the text.

    Correct: `posfet_model.device.film.branch_steepness`. The text swaps Pr and Ps: (1 + 5/2)/(1 - 5/2) = -2.333.

    Parameters
    ----------
    coercive_field : float
        Ec [V/m].
    remnant_polarisation, saturation_polarisation : float
        Pr, Ps [C/m2], in [0, 10] and [1e-9, 10]; here Pr may exceed Ps.

    Returns
    -------
    float
        delta [V/m]; NaN where the logarithm is undefined, infinite or zero: Pr >= Ps, or Pr = 0.
    """
    coercive_field = real_number("coercive_field", coercive_field, *COERCIVE_FIELD_RANGE)
    remnant = real_number("remnant_polarisation", remnant_polarisation, 0, POLARISATION_LIMIT)
    saturation = real_number("saturation_polarisation", saturation_polarisation, 1e-9, POLARISATION_LIMIT)
    if not 0 < remnant < saturation:
        return math.nan
    return coercive_field / math.log1p(2 * remnant / (saturation - remnant))


def threshold_shift(charge: ArrayLike, stack: Stack) -> FloatArray:
    """Return eq. (6) and (7) as printed: ``dV = -Psw/Cox``, the whole charge uncompensated.

    Correct: `posfet_model.device.transistor.threshold_shift`.

    Parameters
    ----------
    charge : array_like
        Psw [C/m2].
    stack : Stack
        Capacitances of oxide and film.

    Returns
    -------
    ndarray
        dV [V], of the shape of `charge`.
    """
    return -real_array("charge", charge, -_CHARGE_LIMIT, _CHARGE_LIMIT) / instance("stack", stack, Stack).oxide


def signal_current(charge: ArrayLike, overdrive: ArrayLike, mobility: float, aspect: float, stack: Stack) -> FloatArray:
    """Return the drain current [A] caused by a charge in saturation, as the paper's equations combine.

    ``mu*Cstack*(W/L)*(Vgs - Vth)*(sigma/Cox)``: the charge is divided by the oxide's capacitance (eq. 6), the current
    is driven through the whole stack (eq. 9). Correct: the same plane for both, Cox/Cpvdf (18.06 with Table I) times as
    much.

    Parameters
    ----------
    charge : array_like
        sigma [C/m2].
    overdrive : array_like
        Vgs - Vth [V].
    mobility : float
        mu [m2/(V s)].
    aspect : float
        W/L [1].
    stack : Stack
        Capacitances of oxide and film.

    Returns
    -------
    ndarray
        Current [A], of the broadcast shape.
    """
    charge, overdrive = common_dtype(
        charge=real_array("charge", charge, -_CHARGE_LIMIT, _CHARGE_LIMIT),
        overdrive=real_array("overdrive", overdrive, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
    )
    stack = instance("stack", stack, Stack)
    aspect = real_number("aspect", aspect, 1e-9, 1e9)
    gain_factor = real_number("mobility", mobility, 1e-9, 100) * stack.series * aspect
    return gain_factor * overdrive * (charge / stack.oxide)


def saturation_current(gate_voltage: ArrayLike, threshold_voltage: ArrayLike, gain_factor: ArrayLike) -> FloatArray:
    """Return eq. (10) as printed: ``Id = beta*(Vgs - Vth)^2`` for Vgs > Vth, without the factor 1/2.

    Correct: `posfet_model.device.transistor.drain_current`.

    Parameters
    ----------
    gate_voltage, threshold_voltage : array_like
        Vgs, Vth [V].
    gain_factor : array_like
        beta [A/V2].

    Returns
    -------
    ndarray
        Id [A], of the broadcast shape.
    """
    gate_voltage, threshold_voltage, gain_factor = common_dtype(
        gate_voltage=real_array("gate_voltage", gate_voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
        threshold_voltage=real_array("threshold_voltage", threshold_voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT),
        gain_factor=real_array("gain_factor", gain_factor, *GAIN_FACTOR_RANGE),
    )
    on: FloatArray = np.maximum(gate_voltage - threshold_voltage, 0)
    return gain_factor * on**2


def circular_deflection(
    pressure: ArrayLike, radius: ArrayLike, thickness: ArrayLike, young_modulus: ArrayLike, poisson_ratio: ArrayLike
) -> FloatArray:
    """Return eq. (12) as printed: ``y = 3*P*(1 - nu^2)*r^4/(16*pi*E*h^3)``, with an extra factor pi.

    Correct: `posfet_model.device.mechanics.circular_deflection`.

    Parameters
    ----------
    pressure : array_like
        P [Pa].
    radius, thickness : array_like
        r, h [m].
    young_modulus : array_like
        E [Pa].
    poisson_ratio : array_like
        nu [1].

    Returns
    -------
    ndarray
        y [m], of the broadcast shape.
    """
    pressure, radius, thickness, young_modulus, poisson_ratio = common_dtype(
        pressure=real_array("pressure", pressure, 0, PRESSURE_LIMIT),
        radius=real_array("radius", radius, *LENGTH_RANGE),
        thickness=real_array("thickness", thickness, *LENGTH_RANGE),
        young_modulus=real_array("young_modulus", young_modulus, *MODULUS_RANGE),
        poisson_ratio=real_array("poisson_ratio", poisson_ratio, *POISSON_RANGE),
    )
    coefficient = 3 / (16 * math.pi) * (1 - poisson_ratio**2)
    return coefficient * (pressure / young_modulus) * (radius / thickness) ** 3 * radius


def square_deflection(
    pressure: ArrayLike, side: ArrayLike, thickness: ArrayLike, young_modulus: ArrayLike
) -> FloatArray:
    """Return eq. (13) as printed: ``y = 0.0138*P*a^4/(E*h^3)``, which is correct for nu = 0.3.

    For any nu: `posfet_model.device.mechanics.square_deflection`.

    Parameters
    ----------
    pressure : array_like
        P [Pa].
    side, thickness : array_like
        a, h [m].
    young_modulus : array_like
        E [Pa].

    Returns
    -------
    ndarray
        y [m], of the broadcast shape.
    """
    pressure, side, thickness, young_modulus = common_dtype(
        pressure=real_array("pressure", pressure, 0, PRESSURE_LIMIT),
        side=real_array("side", side, *LENGTH_RANGE),
        thickness=real_array("thickness", thickness, *LENGTH_RANGE),
        young_modulus=real_array("young_modulus", young_modulus, *MODULUS_RANGE),
    )
    return 0.0138 * (pressure / young_modulus) * (side / thickness) ** 3 * side
