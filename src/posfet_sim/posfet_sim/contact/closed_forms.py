# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Closed forms of contact mechanics: contact width and indentation of line contacts, flat indenters and ellipses.

Elastic half-space without friction, adhesion and viscosity. The effective modulus E [Pa] of the two bodies is
1/E = (1 - nu1^2)/E1 + (1 - nu2^2)/E2.

References
----------
Johnson: K. L. Johnson, Contact Mechanics, Cambridge, 1985.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model._lib.validation import real_number

FORCE_LIMIT: Final = 1e6
"""Maximum normal force [N]."""


def cylinder_half_width(line_load: float, radius: float, effective_modulus: float) -> float:
    """Return the half-width b of the contact of a cylinder.

    ``b^2 = 4*P*R/(pi*E)``, with the pressure ``2*P/(pi*b)*sqrt(1 - (x/b)^2)`` (Johnson, section 4.2).

    Parameters
    ----------
    line_load : float
        Force per length P [N/m].
    radius : float
        Radius R [m].
    effective_modulus : float
        Effective modulus E [Pa].

    Returns
    -------
    float
        Half-width b [m].
    """
    return math.sqrt(4 * line_load * radius / (math.pi * effective_modulus))


def wedge_half_width(line_load: float, slope: float, effective_modulus: float) -> float:
    """Return the half-width b of the contact of a blunt wedge.

    ``b = P/(E*slope)``, with the pressure ``E*slope/pi*acosh(b/abs(x))`` (Johnson, section 5.2, slope = cot(alpha)).

    Parameters
    ----------
    line_load : float
        Force per length P [N/m].
    slope : float
        Tangent of the angle between flank and surface [1].
    effective_modulus : float
        Effective modulus E [Pa].

    Returns
    -------
    float
        Half-width b [m].
    """
    return line_load / (effective_modulus * slope)


def line_stiffness(length: float, half_width: float, effective_modulus: float, profile: float) -> float:
    """Return the stiffness per length P/d of a contact that is much longer than wide.

    ``P/d = pi*E/(2*ln(2*L/b) + c)``, d at the middle of the contact: the displacement under a pressure that is uniform
    along the length, from Boussinesq's point load (Johnson, section 3.2) integrated over the strip with L >> b. The
    load concentration at the ends of a stiff cylinder is neglected.

    Parameters
    ----------
    length : float
        Length L [m].
    half_width : float
        Half-width b [m].
    effective_modulus : float
        Effective modulus E [Pa].
    profile : float
        Constant c of the pressure profile across: 1 for a cylinder, 2 for a wedge.

    Returns
    -------
    float
        Force per length over indentation [N/m2].
    """
    return math.pi * effective_modulus / (2 * math.log(2 * length / half_width) + profile)


def flat_indentation(force: float, radius: float, effective_modulus: float) -> float:
    """Return the indentation ``F/(2*a*E)`` [m] of a flat circular indenter of radius a [m] (Johnson, section 3.4).

    Parameters
    ----------
    force : float
        Normal force [N].
    radius : float
        Radius a [m].
    effective_modulus : float
        Effective modulus E of object and skin [Pa].
    """
    return force / (2 * radius * effective_modulus)


@dataclass(frozen=True)
class EllipseShape:
    """Elliptic contact of two curved bodies, scaled to a force of 1 N.

    Under a force F [N] the semi-axes are ``along*F^(1/3)`` and ``across*F^(1/3)`` [m], the indentation is
    ``depth*F^(2/3)`` [m].
    """

    along: float
    """Semi-axis along u [m/N^(1/3)]."""
    across: float
    """Semi-axis along v [m/N^(1/3)]."""
    depth: float
    """Indentation [m/N^(2/3)]."""


def hertz_ellipse(along: float, across: float, effective_modulus: float) -> EllipseShape:
    """Return the ellipse of a Hertz contact.

    With semi-axes a >= b, ``e^2 = 1 - (b/a)^2``, the complete elliptic integrals K and E of e, and ``D = (K - E)/e^2``:
    the curvatures' ratio is ``(K - D)/D*(a/b)^2``, ``a^3 = 3*F*D/(pi*E*low)`` with the lower curvature, and the
    indentation ``3*F*K/(2*pi*a*E)`` (Johnson, sections 3.5 and 4.2). The relative error is 1e-9.

    Parameters
    ----------
    along, across : float
        Curvatures of the gap [1/m], in (0, 1e7); their ratio is up to 1e6.
    effective_modulus : float
        Effective modulus E [Pa], in [1e2, 1e13].

    Returns
    -------
    EllipseShape
        Semi-axes and indentation.

    Raises
    ------
    ValueError
        An argument or the ratio is out of range.
    """
    along = real_number("along", along, 0, 1e7, exclusive=True)
    across = real_number("across", across, 0, 1e7, exclusive=True)
    effective_modulus = real_number("effective_modulus", effective_modulus, 1e2, 1e13)
    low, high = min(along, across), max(along, across)
    ratio = _axes_ratio(real_number("ratio of the curvatures", high / low, 1, 1e6))
    first, third = _elliptic(ratio)
    major = (3 * third / (math.pi * effective_modulus * low)) ** (1 / 3)
    minor = major * ratio
    depth = 1.5 * first / (math.pi * major * effective_modulus)
    return EllipseShape(major, minor, depth) if along == low else EllipseShape(minor, major, depth)


def _axes_ratio(curvatures: float) -> float:
    """Return b/a in (0, 1] for a ratio of the curvatures in [1, 1e6], by bisection."""
    low, high = 1e-6, 1.0
    for _ in range(60):
        middle = math.sqrt(low * high)
        first, third = _elliptic(middle)
        low, high = (middle, high) if (first - third) / (third * middle**2) > curvatures else (low, middle)
    return high


def _elliptic(ratio: float) -> tuple[float, float]:
    """Return K and D = (K - E)/e^2 for e^2 = 1 - ratio^2, by the arithmetic-geometric mean."""
    square = 1 - ratio**2
    mean, geometric, power = 1.0, ratio, 1.0
    ratio_sum = square / 2  # (K - E)/K is the sum of 2^(n-1)*c_n^2, c_0 = e
    while mean - geometric > 1e-12 * mean:
        difference = (mean - geometric) / 2
        mean, geometric = (mean + geometric) / 2, math.sqrt(mean * geometric)
        ratio_sum += power * difference**2
        power *= 2
    first = math.pi / (2 * mean)
    return first, first * ratio_sum / square if square > 0 else math.pi / 4
