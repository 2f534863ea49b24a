# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mechanics of the thinned chip: etch mask, deflection of the membrane under pressure, strain of a bent chip.

Deflections are those of thin plates, clamped at the edge, under uniform pressure (S. Timoshenko and S.
Woinowsky-Krieger, Theory of Plates and Shells, 2nd ed., 1959, eq. 62 and Table 35), small compared with the thickness.
Lengths in m, pressure and moduli in Pa. Arrays of any shapes that broadcast together are accepted; float32 arrays stay
float32 when combined with scalars.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray, Mask
from posfet_model._lib.validation import common_dtype, instance, real_array, real_number

SQUARE_PLATE_COEFFICIENT: Final = 0.00126531908748
"""Deflection at the centre of a clamped square plate, in P*a^4/D [1]; Timoshenko's table rounds it to 0.00126."""

LENGTH_RANGE: Final = (1e-9, 1.0)
"""Accepted lengths [m]: thickness, radius, side."""

PRESSURE_LIMIT: Final = 1e12
"""Largest accepted pressure [Pa]."""

MODULUS_RANGE: Final = (1e3, 2e12)
"""Accepted Young's moduli [Pa], rubber to diamond."""

POISSON_RANGE: Final = (-0.999, 0.5)
"""Accepted Poisson's ratios [1]."""


@dataclass(frozen=True)
class Deflection:
    """Deflection at the centre, and whether small-deflection theory is valid there.

    Where `small` is False the deflection is that of the linear theory, not of the plate, which stretches and is
    stiffer.
    """

    deflection: FloatArray
    """Deflection y [m]."""
    small: Mask
    """Whether y is at most half the thickness, so that small-deflection theory is valid."""


@dataclass(frozen=True)
class Layer:  # numpydoc ignore=PR02
    """A layer of a bent chip.

    Parameters
    ----------
    thickness : float
        Thickness [m], in [1e-9, 1].
    young_modulus : float
        Young's modulus E [Pa], in [1e3, 2e12].
    poisson_ratio : float
        Poisson's ratio nu [1], in [-0.999, 0.5].

    Raises
    ------
    ValueError
        A value is not real, not finite or out of range.
    """

    thickness: float
    young_modulus: float
    poisson_ratio: float

    def __post_init__(self) -> None:
        real_number("thickness", self.thickness, *LENGTH_RANGE)
        real_number("young_modulus", self.young_modulus, *MODULUS_RANGE)
        real_number("poisson_ratio", self.poisson_ratio, *POISSON_RANGE)

    @property
    def plane_modulus(self) -> float:
        """Plane-strain modulus E/(1 - nu^2) [Pa]: stiffness of a wide layer, which cannot contract sideways."""
        return self.young_modulus / (1 - self.poisson_ratio**2)


@dataclass(frozen=True)
class Bending:
    """A chip on a cylinder: neutral axis [m] above its back, strain [1] of back, top and middle of the top layer."""

    neutral_axis: float
    back_strain: float
    top_strain: float
    film_strain: float


def mask_opening(membrane_width: ArrayLike, etch_depth: ArrayLike) -> FloatArray:
    """Return the opening W [m] in the back-side mask that leaves a membrane of the given width: ``W = W0 + sqrt(2)*H``.

    Eq. (11): KOH etches side walls at arctan(sqrt(2)) = 54.74 degrees, H/sqrt(2) on either side.

    Parameters
    ----------
    membrane_width : array_like
        W0 [m], in [1e-9, 1].
    etch_depth : array_like
        H [m], in [1e-9, 1].

    Returns
    -------
    ndarray
        W [m], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The equation is correct; the paper's wording ("times more") is not: sqrt(2)*H is added.

    Examples
    --------
    >>> print(f"{(mask_opening(1e-2, 450e-6) - 1e-2) * 1e6:.2f} um")
    636.40 um
    """
    membrane_width, etch_depth = common_dtype(
        membrane_width=real_array("membrane_width", membrane_width, *LENGTH_RANGE),
        etch_depth=real_array("etch_depth", etch_depth, *LENGTH_RANGE),
    )
    return membrane_width + math.sqrt(2) * etch_depth


def circular_deflection(
    pressure: ArrayLike, radius: ArrayLike, thickness: ArrayLike, young_modulus: ArrayLike, poisson_ratio: ArrayLike
) -> Deflection:
    """Return the deflection of a clamped circular membrane: ``y = 3*P*(1 - nu^2)*r^4/(16*E*h^3)``, eq. (12).

    Parameters
    ----------
    pressure : array_like
        P [Pa], in [0, 1e12].
    radius, thickness : array_like
        r, h [m], in [1e-9, 1].
    young_modulus : array_like
        E [Pa], in [1e3, 2e12].
    poisson_ratio : array_like
        nu [1], in [-0.999, 0.5].

    Returns
    -------
    Deflection
        y [m] at the centre, of the broadcast shape, and its validity.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper prints another pi in the denominator, which makes the deflection 3.14 times too small; with
    D = E*h^3/(12*(1 - nu^2)) that of the plate is P*r^4/(64*D). `posfet_model.device.as_printed` has the printed form.
    """
    return _deflection(3 / 16, pressure, "radius", radius, thickness, young_modulus, poisson_ratio)


def square_deflection(
    pressure: ArrayLike, side: ArrayLike, thickness: ArrayLike, young_modulus: ArrayLike, poisson_ratio: ArrayLike
) -> Deflection:
    """Return the deflection of a clamped square membrane: ``y = 0.015184*(1 - nu^2)*P*a^4/(E*h^3)``, eq. (13).

    Parameters
    ----------
    pressure : array_like
        P [Pa], in [0, 1e12].
    side, thickness : array_like
        a, h [m], in [1e-9, 1].
    young_modulus : array_like
        E [Pa], in [1e3, 2e12].
    poisson_ratio : array_like
        nu [1], in [-0.999, 0.5].

    Returns
    -------
    Deflection
        y [m] at the centre, of the broadcast shape, and its validity.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    The paper prints 0.0138*P*a^4/(E*h^3): the same for nu = 0.3, where the coefficient is 0.013817.

    Examples
    --------
    >>> bent = square_deflection([90.0, 105.0], 1e-2, 20e-6, 169e9, 0.3)
    >>> [f"{value * 1e6:.2f}" for value in bent.deflection], bent.small.tolist()
    (['9.20', '10.73'], [True, False])
    """
    coefficient = 12 * SQUARE_PLATE_COEFFICIENT
    return _deflection(coefficient, pressure, "side", side, thickness, young_modulus, poisson_ratio)


def circular_thickness(
    deflection: ArrayLike, pressure: ArrayLike, radius: ArrayLike, young_modulus: ArrayLike, poisson_ratio: ArrayLike
) -> FloatArray:
    """Return the thickness h [m] at which a clamped circular membrane deflects by y: the inverse of eq. (12).

    Parameters
    ----------
    deflection : array_like
        y [m], in [1e-15, 1].
    pressure : array_like
        P [Pa], in [1e-6, 1e12].
    radius : array_like
        r [m], in [1e-9, 1].
    young_modulus : array_like
        E [Pa], in [1e3, 2e12].
    poisson_ratio : array_like
        nu [1], in [-0.999, 0.5].

    Returns
    -------
    ndarray
        h [m], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    Small-deflection theory is valid for y <= h/2.
    """
    return _thickness(3 / 16, deflection, pressure, "radius", radius, young_modulus, poisson_ratio)


def square_thickness(
    deflection: ArrayLike, pressure: ArrayLike, side: ArrayLike, young_modulus: ArrayLike, poisson_ratio: ArrayLike
) -> FloatArray:
    """Return the thickness h [m] at which a clamped square membrane deflects by y: the inverse of eq. (13).

    Parameters
    ----------
    deflection : array_like
        y [m], in [1e-15, 1].
    pressure : array_like
        P [Pa], in [1e-6, 1e12].
    side : array_like
        a [m], in [1e-9, 1].
    young_modulus : array_like
        E [Pa], in [1e3, 2e12].
    poisson_ratio : array_like
        nu [1], in [-0.999, 0.5].

    Returns
    -------
    ndarray
        h [m], of the broadcast shape.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.

    Notes
    -----
    Small-deflection theory is valid for y <= h/2.
    """
    coefficient = 12 * SQUARE_PLATE_COEFFICIENT
    return _thickness(coefficient, deflection, pressure, "side", side, young_modulus, poisson_ratio)


def bend_on_cylinder(layers: Sequence[Layer], cylinder_radius: float) -> Bending:
    """Return the strain of a chip bent over a cylinder, its back on the cylinder, the film on top and outside.

    The neutral axis, ``zn = sum(Ei*ti*zi)/sum(Ei*ti)`` with plane-strain moduli and mid-heights, keeps its length; at
    the height z the strain is ``(z - zn)/(R + zn)``, tension positive.

    Parameters
    ----------
    layers : sequence of Layer
        Layers from the back to the top, at least one; the last is the film.
    cylinder_radius : float
        R [m], in [1e-6, 1e6].

    Returns
    -------
    Bending
        Neutral axis [m] and strains [1].

    Raises
    ------
    ValueError
        `layers` is not a sequence of `Layer` or is empty, or the radius is not real, not finite or out of range.

    Notes
    -----
    The paper gives no equation for it. Layers are assumed perfectly bonded, free of initial stress and elastic; silicon
    fractures at a strain of some 0.5 to 1 %, which is not checked here.

    Examples
    --------
    >>> chip = bend_on_cylinder([Layer(20e-6, 169e9, 0.3), Layer(2.5e-6, 3e9, 0.35)], 10e-3)
    >>> print(f"{chip.neutral_axis * 1e6:.3f} um, {chip.back_strain:.2e}, {chip.film_strain:.2e}")
    10.026 um, -1.00e-03, 1.12e-03
    """
    if not isinstance(layers, Sequence) or not layers:
        raise ValueError(f"layers must be a sequence of one Layer or more, got {layers!r:.60}")
    layers = [instance("layers", layer, Layer) for layer in layers]
    radius = real_number("cylinder_radius", cylinder_radius, 1e-6, 1e6)
    tops = np.cumsum([layer.thickness for layer in layers])
    middles = tops - [layer.thickness / 2 for layer in layers]
    stiffness = np.array([layer.plane_modulus * layer.thickness for layer in layers])
    neutral = float(stiffness @ middles / stiffness.sum())
    back, top, film = ((z - neutral) / (radius + neutral) for z in (0.0, float(tops[-1]), float(middles[-1])))
    return Bending(neutral, back, top, film)


def _deflection(
    coefficient: float, pressure: ArrayLike, span_name: str, span: ArrayLike, *plate: ArrayLike
) -> Deflection:
    """Return y = coefficient*(1 - nu^2)*P*s^4/(E*h^3) for the thickness, modulus and Poisson's ratio in `plate`."""
    thickness, modulus, poisson = plate
    pressure, span, thickness, modulus, poisson = common_dtype(
        **{
            "pressure": real_array("pressure", pressure, 0, PRESSURE_LIMIT),
            span_name: real_array(span_name, span, *LENGTH_RANGE),
            "thickness": real_array("thickness", thickness, *LENGTH_RANGE),
            "young_modulus": real_array("young_modulus", modulus, *MODULUS_RANGE),
            "poisson_ratio": real_array("poisson_ratio", poisson, *POISSON_RANGE),
        }
    )
    # Grouped into ratios near 1, so that float32 neither over- nor underflows.
    deflection = coefficient * (1 - poisson**2) * (pressure / modulus) * (span / thickness) ** 3 * span
    small: Mask = deflection <= thickness / 2
    return Deflection(deflection, np.asarray(small))


def _thickness(
    coefficient: float, deflection: ArrayLike, pressure: ArrayLike, span_name: str, span: ArrayLike, *plate: ArrayLike
) -> FloatArray:
    """Return the thickness h at which `_deflection` gives y."""
    modulus, poisson = plate
    deflection, pressure, span, modulus, poisson = common_dtype(
        **{
            "deflection": real_array("deflection", deflection, 1e-15, 1),
            "pressure": real_array("pressure", pressure, 1e-6, PRESSURE_LIMIT),
            span_name: real_array(span_name, span, *LENGTH_RANGE),
            "young_modulus": real_array("young_modulus", modulus, *MODULUS_RANGE),
            "poisson_ratio": real_array("poisson_ratio", poisson, *POISSON_RANGE),
        }
    )
    return span * np.cbrt(coefficient * (1 - poisson**2) * (pressure / modulus) * (span / deflection))
