"""The paper's formulas as they are printed, misprints included, for comparison with the right ones.

Nothing else in this package uses them. Each has the name of the right function; docs/errata.md has the numbers.
The arguments are those of the right functions, in the same units, and are taken as they come: a formula that has no
value gives NaN.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from posfet_model.checks import FloatArray, real_array, real_number
from posfet_model.constants import VACUUM_PERMITTIVITY
from posfet_model.transistor import Stack


def electric_displacement(
    stress: ArrayLike, piezoelectric_coefficient: ArrayLike, relative_permittivity: ArrayLike
) -> FloatArray:
    """Return eq. (1) as printed: ``D3 = d33*T3 + eps33*T3``.

    Right: `posfet_model.charge.electric_displacement`. The second T3 should be E3; the printed sum adds unlike units.
    """
    stress = real_array("stress", stress)
    permittivity = real_array("relative_permittivity", relative_permittivity) * VACUUM_PERMITTIVITY
    return real_array("piezoelectric_coefficient", piezoelectric_coefficient) * stress + permittivity * stress


def branch_steepness(coercive_field: float, remnant_polarisation: float, saturation_polarisation: float) -> float:
    """Return eq. (3) as printed, for the polarisations as the text has them: NaN where the logarithm has none.

    Right: `posfet_model.film.branch_steepness`. The text swaps Pr and Ps: (1 + 5/2)/(1 - 5/2) = -2.333.
    """
    ratio = real_number("remnant_polarisation", remnant_polarisation) / real_number(
        "saturation_polarisation", saturation_polarisation, 0, exclusive=True
    )
    inside = (1 + ratio) / (1 - ratio) if ratio != 1 else math.inf
    coercive_field = real_number("coercive_field", coercive_field)
    return coercive_field / math.log(inside) if inside > 0 else math.nan


def threshold_shift(charge: ArrayLike, stack: Stack) -> FloatArray:
    """Return eq. (6) and (7) as printed: ``dV = -Psw/Cox``, the whole charge uncompensated.

    Right: `posfet_model.transistor.threshold_shift`.
    """
    return -real_array("charge", charge) / stack.oxide


def signal_current(charge: ArrayLike, overdrive: ArrayLike, mobility: float, aspect: float, stack: Stack) -> FloatArray:
    """Return the drain current [A] that a charge [C/m2] causes in saturation, as the paper's equations combine.

    ``mu*Cstack*(W/L)*(Vgs - Vth)*(sigma/Cox)``: the charge counted at the oxide (eq. 6), the current driven through the
    whole stack (eq. 9). Right: the same plane for both, Cox/Cpvdf (18.06 with Table I) times as much.
    """
    shift = real_array("charge", charge) / stack.oxide
    gain_factor = mobility * stack.series * aspect
    return gain_factor * real_array("overdrive", overdrive) * shift


def saturation_current(gate_voltage: ArrayLike, threshold_voltage: ArrayLike, gain_factor: ArrayLike) -> FloatArray:
    """Return eq. (10) as printed: ``Id = beta*(Vgs - Vth)^2`` where Vgs > Vth, without the factor 1/2.

    Right: `posfet_model.transistor.drain_current`.
    """
    overdrive = real_array("gate_voltage", gate_voltage) - real_array("threshold_voltage", threshold_voltage)
    on: FloatArray = np.maximum(overdrive, 0)
    return real_array("gain_factor", gain_factor) * on**2


def circular_deflection(
    pressure: ArrayLike, radius: ArrayLike, thickness: ArrayLike, young_modulus: ArrayLike, poisson_ratio: ArrayLike
) -> FloatArray:
    """Return eq. (12) as printed: ``y = 3*P*(1 - nu^2)*r^4/(16*pi*E*h^3)``, with a pi too many.

    Right: `posfet_model.mechanics.circular_deflection`.
    """
    pressure, radius = real_array("pressure", pressure), real_array("radius", radius)
    thickness, young_modulus = real_array("thickness", thickness), real_array("young_modulus", young_modulus)
    narrowing = 1 - real_array("poisson_ratio", poisson_ratio) ** 2
    return 3 * pressure * narrowing * radius**4 / (16 * math.pi * young_modulus * thickness**3)


def square_deflection(
    pressure: ArrayLike, side: ArrayLike, thickness: ArrayLike, young_modulus: ArrayLike
) -> FloatArray:
    """Return eq. (13) as printed: ``y = 0.0138*P*a^4/(E*h^3)``; right for nu = 0.3.

    For any nu: `posfet_model.mechanics.square_deflection`.
    """
    pressure, side = real_array("pressure", pressure), real_array("side", side)
    thickness, young_modulus = real_array("thickness", thickness), real_array("young_modulus", young_modulus)
    return 0.0138 * pressure * side**4 / (young_modulus * thickness**3)
