"""Pressure of a round object on the array: Hertz contact, spread by the elastic cover, collected by the taxels.

What a taxel collects and how the cover spreads is said in contact_pressure_cells.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.contact_pressure_cells import NORMAL_END, cell_edges, normal_below, window
from posfet_driver.contact_pressure_rules import hertz_disc
from posfet_model.checks import FloatArray, real_number
from posfet_model.sensor import Layout

RADIUS_RANGE: Final = (1e-6, 10.0)
"""Accepted radii of a sphere [m]."""

MODULUS_RANGE: Final = (1e2, 1e13)
"""Accepted effective moduli [Pa]."""

FORCE_LIMIT: Final = 1e6
"""Largest accepted normal force [N]."""

SHARP_ABOVE: Final = 50.0
"""Contact radius over spread above which the spread is left out; it would move at most 5e-4 of the force."""


@dataclass(frozen=True)
class HertzContact:
    """Circle in which a sphere touches a flat."""

    radius: float
    """a [m]."""
    peak_pressure: float
    """p0 [Pa], in the middle; p(r) = p0*sqrt(1 - (r/a)^2)."""
    indentation: float
    """Approach of the sphere's centre from first touch [m]."""


def hertz_sphere(force: float, radius: float, effective_modulus: float) -> HertzContact:
    """Return the contact of a sphere pressed on a flat half-space.

    ``a^3 = 3*F*R/(4*E)``, ``p0 = 3*F/(2*pi*a^2)``, ``indentation = a^2/R`` (Johnson, Contact Mechanics, 1985,
    eq. 4.22-4.24), with ``1/E = (1 - nu1^2)/E1 + (1 - nu2^2)/E2``.

    Parameters
    ----------
    force : F [N], normal, in [0, 1e6].
    radius : R [m], in [1e-6, 10].
    effective_modulus : E [Pa], in [1e2, 1e13].

    Raises
    ------
    ValueError : an argument is not a finite number in its range.

    Notes
    -----
    Without friction and adhesion, elastic and quasi-static. Meant for a well below R; the scene reader refuses a > R.

    Examples
    --------
    >>> contact = hertz_sphere(1.5, 6e-3, 1e6)
    >>> print(f"{contact.radius * 1e3:.4f} mm, {contact.peak_pressure / 1e3:.1f} kPa")
    1.8899 mm, 200.5 kPa
    """
    force = real_number("force", force, 0, FORCE_LIMIT)
    radius = real_number("radius", radius, *RADIUS_RANGE)
    effective_modulus = real_number("effective_modulus", effective_modulus, *MODULUS_RANGE)
    if force == 0:
        return HertzContact(0.0, 0.0, 0.0)
    contact_radius = _contact_radius(force, radius / effective_modulus)
    return HertzContact(contact_radius, 1.5 * force / (math.pi * contact_radius**2), contact_radius**2 / radius)


class SphereOnArray:
    """Forces of the taxels under one sphere.

    Only the taxels within reach of the contact (its radius and 6.5 standard deviations of the spread) are computed.
    The error of a taxel's force is below 3e-6 of the total while the contact radius is at most `SHARP_ABOVE` times the
    spread, and without spread exact to rounding; in between (spread present but smaller) it is below 5e-4.
    """

    def __init__(self, layout: Layout, spread: float, radius: float, effective_modulus: float) -> None:
        """Take the array, the standard deviation of the cover's spread [m], and the sphere as in `hertz_sphere`.

        Raises ValueError for a spread outside [0, 1] and for what `hertz_sphere` refuses.
        """
        self._spread = real_number("spread", spread, 0, 1)
        radius = real_number("radius", radius, *RADIUS_RANGE)
        self._compliance = radius / real_number("effective_modulus", effective_modulus, *MODULUS_RANGE)
        self._pitch = (layout.pitch_x, layout.pitch_y)
        self._edges = (cell_edges(layout.cols, layout.pitch_x), cell_edges(layout.rows, layout.pitch_y))

    def add(self, forces: FloatArray, x: float, y: float, force: float) -> None:
        """Add the force [N] of each taxel to `forces`, shape [rows, cols], for a sphere at (x, y) [m] with `force` [N].

        The hot path of a simulation: the arguments are not checked, the scene was when it was read.
        """
        if force <= 0:
            return
        contact_radius = _contact_radius(force, self._compliance)
        reach = contact_radius + NORMAL_END * self._spread
        cols = window(self._edges[0], self._pitch[0], x, reach)
        rows = window(self._edges[1], self._pitch[1], y, reach)
        if cols.stop <= cols.start or rows.stop <= rows.start:
            return
        edges_x = self._edges[0][cols.start : cols.stop + 1] - x
        edges_y = self._edges[1][rows.start : rows.stop + 1] - y
        if contact_radius > SHARP_ABOVE * self._spread:
            share = _sharp_shares(edges_x / contact_radius, edges_y / contact_radius)
        else:
            share = _spread_shares(edges_x / self._spread, edges_y / self._spread, contact_radius / self._spread)
        forces[rows, cols] += force * share


def _contact_radius(force: float, compliance: float) -> float:
    """Return the Hertz radius a [m]; compliance is R/E."""
    return math.pow(0.75 * force * compliance, 1 / 3)


def _spread_shares(
    edges_x: NDArray[np.float64], edges_y: NDArray[np.float64], contact_radius: float
) -> NDArray[np.float64]:
    """Return each cell's share of the force, shape [rows, cols]; lengths in units of the spread, sphere at 0.

    The Gaussian over a cell is a product of differences of the normal distribution; the Hertz pressure is summed by a
    product rule. Its order, 2*ceil(a/s) + 2, keeps the error below 3e-6 (found by comparison with twice the order).
    """
    rule = hertz_disc(2 * math.ceil(contact_radius) + 2)
    offset_x = rule.x[:, None] * contact_radius
    below_x = normal_below(edges_x - offset_x) + normal_below(edges_x + offset_x)
    below_y = rule.y_weight @ normal_below(edges_y - rule.y[:, :, None] * contact_radius)
    within_x = below_x[:, 1:] - below_x[:, :-1]
    within_y = (below_y[:, 1:] - below_y[:, :-1]) * rule.x_weight[:, None]
    shares: NDArray[np.float64] = within_y.T @ within_x
    return shares


def _sharp_shares(edges_x: NDArray[np.float64], edges_y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each cell's share of the force without spread, shape [rows, cols]; lengths in units of the contact radius.

    Second difference over the cell's corners of the integral of sqrt(1 - x^2 - y^2) from (0, 0) to (X, Y),
    ``XYZ/3 + X(3 - X^2)/6*atan(Y/Z) + Y(3 - Y^2)/6*atan(X/Z) - atan(XY/Z)/3`` with ``Z = sqrt(1 - X^2 - Y^2)``; a
    corner outside the circle takes Z = 0 with X and Y held within [-1, 1].
    """
    x = np.clip(edges_x, -1, 1)[None, :]
    y = np.clip(edges_y, -1, 1)[:, None]
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    volume = (
        x * y * z / 3
        + x * (3 - x * x) / 6 * np.arctan2(y, z)
        + y * (3 - y * y) / 6 * np.arctan2(x, z)
        - np.arctan2(x * y, z) / 3
    )
    shares: NDArray[np.float64] = np.diff(np.diff(volume, axis=0), axis=1) * (1.5 / math.pi)
    return shares
