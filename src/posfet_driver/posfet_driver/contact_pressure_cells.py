"""From a contact to the taxels: spread by the elastic cover, and collected by the cells under it.

Force of a taxel
----------------
A taxel's area (1 mm2 on the shipped chip) is smaller than its cell (pitch times pitch, 2.25 mm2). Here the elastic
cover carries the load of a whole cell to the taxel under it (assumed): the *force of a taxel* is the force on its cell,
and the forces of all taxels add up to the force on the array. What presses beyond the outermost cells is lost.

Cover
-----
The cover blurs the pressure with a Gaussian of standard deviation s (assumed shape). Total force and centre of pressure
are unchanged by it. The subsurface stress of an elastic half-space (Boussinesq) has a sharper top and wider tails;
`spread_of_cover` says which Gaussian comes nearest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_driver.loads import Patch
from posfet_model.checks import real_number
from posfet_model.sensor import Layout

FINEST_SPREAD: Final = 1 / 50
"""Least spread that `Cells` computes with, as a share of a footprint's half-length; it moves at most 5e-4 of a sphere's
force."""

SPREAD_PER_THICKNESS: Final = 0.70
"""Standard deviation of the Gaussian over the thickness of the cover; see `spread_of_cover`."""

NORMAL_END: Final = 6.5
"""Reach of the Gaussian in standard deviations: 1 - Phi(6.5) = 4e-11 is set to 0, so that every force is shared out
without rest."""

_NORMAL_STEP: Final = 1 / 512  # linear interpolation is then right to step^2/8 * max|phi'| = 1.2e-7
_NORMAL_GRID: Final = np.arange(-NORMAL_END, NORMAL_END + _NORMAL_STEP / 2, _NORMAL_STEP)
_NORMAL: Final = np.array([0.5 * math.erfc(-z / math.sqrt(2)) for z in _NORMAL_GRID])
_NORMAL[[0, -1]] = 0.0, 1.0
_NORMAL_RISE: Final = np.append(np.diff(_NORMAL), 0.0)
_LARGE: Final = 150  # values from which it is faster to reckon the place in the table than to search for it
_ALIGNED: Final = 1e-9  # an object turned by less [rad] counts as along the rows or the columns


def spread_of_cover(thickness: float) -> float:
    """Return the standard deviation of the Gaussian [m] that stands for a cover of a thickness h [m], in [0, 0.1].

    ``s = 0.70*h``: of all Gaussians the one whose shares of a point force on cells of 1.5 h to 2 h come nearest to
    those of an elastic half-space, in which the force F gives at depth h the normal stress
    ``3*F*h^3/(2*pi*(r^2 + h^2)^(5/2))`` (Boussinesq; Johnson, Contact Mechanics, 1985, section 3.2).

    Notes
    -----
    A cell's share of a point force is off by up to 0.037 of the force (0.061 for cells of 1 h or 2.5 h); that of a wide
    contact by less. The half-space's wide tails are left out. A cover bonded to a stiff chip is no half-space; both are
    approximations.
    """
    return SPREAD_PER_THICKNESS * real_number("thickness", thickness, 0, 0.1)


def normal_below(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard normal distribution function, right to 1.2e-7; exactly 0 and 1 beyond +-6.5."""
    if z.size < _LARGE:
        values: NDArray[np.float64] = np.interp(z, _NORMAL_GRID, _NORMAL)
        return values
    place = z * (1 / _NORMAL_STEP)
    place += NORMAL_END / _NORMAL_STEP
    np.maximum(place, 0.0, out=place)
    np.minimum(place, len(_NORMAL) - 0.5, out=place)
    index = place.astype(np.intp)
    place -= index
    place *= _NORMAL_RISE.take(index)
    place += _NORMAL.take(index)
    return place


def cell_edges(count: int, pitch: float) -> NDArray[np.float64]:
    """Return the limits of the cells along one axis [m], shape [count + 1], the array's middle at 0."""
    return (np.arange(count + 1, dtype=np.float64) - count / 2) * pitch


def window(edges: NDArray[np.float64], pitch: float, centre: float, reach: float) -> slice:
    """Return the cells that [centre - reach, centre + reach] touches; empty when it misses the array."""
    count = len(edges) - 1
    middle = centre / pitch + count / 2
    return slice(max(math.floor(middle - reach / pitch), 0), min(math.ceil(middle + reach / pitch), count))


def points_for(extent: float, spread: float, widest: float) -> int:
    """Return how many points a pressure needs over a half-length `extent` [m], even: ``2*ceil(extent/s) + 2``.

    `widest` [m] is the greatest half-length of the footprint. A cell's share is then right to 3e-6 (found by comparison
    with twice as many).
    """
    return 2 * math.ceil(extent / max(spread, FINEST_SPREAD * widest)) + 2


class Footprint(NamedTuple):
    """Where and how a contact presses, as weighted points (u_i, v_ij) in the frame of the object.

    A tuple, as one is made for each object and scan.
    """

    half_length: float
    """Greatest distance of u from 0 [m]."""
    half_width: float
    """Greatest distance of v from 0 [m]."""
    u: NDArray[np.float64]
    """In half-lengths, shape [n]; with `mirrored` [2*n], the second half -1 times the first."""
    u_weight: NDArray[np.float64]
    """Share of the force at each u, shape [n]."""
    v: NDArray[np.float64]
    """In half-widths, shape [n, m]; [1, m] when the same at each u."""
    v_weight: NDArray[np.float64]
    """Shape [m]; sums to 1."""
    mirrored: bool
    """Whether weights and v are those of -u, too; v is then symmetric about 0."""


class Cells:
    """The taxels of an array under an elastic cover."""

    def __init__(self, layout: Layout, spread: float) -> None:
        """Take the array and the standard deviation of the cover's spread [m], in [0, 1]."""
        self.spread = real_number("spread", spread, 0, 1)
        self._pitch = (layout.pitch_x, layout.pitch_y)
        self._edges = (cell_edges(layout.cols, layout.pitch_x), cell_edges(layout.rows, layout.pitch_y))

    def press(self, footprints: Sequence[Footprint], x: float, y: float, angle: float, force: float) -> Patch | None:
        """Return the forces [N] of the taxels under a contact at (x, y) [m], turned by `angle` [rad] about z.

        Only the taxels within reach (the footprints and 6.5 standard deviations) are met; None when there are none.
        """
        cos, sin = math.cos(angle), math.sin(angle)
        half_length, half_width = footprints[0][:2]
        for footprint in footprints[1:]:
            half_length = max(half_length, footprint.half_length)
            half_width = max(half_width, footprint.half_width)
        spread = max(self.spread, FINEST_SPREAD * max(half_length, half_width))
        reach_x = abs(cos) * half_length + abs(sin) * half_width + NORMAL_END * spread
        reach_y = abs(sin) * half_length + abs(cos) * half_width + NORMAL_END * spread
        cols = window(self._edges[0], self._pitch[0], x, reach_x)
        rows = window(self._edges[1], self._pitch[1], y, reach_y)
        if cols.stop <= cols.start or rows.stop <= rows.start:
            return None
        scale = 1 / spread
        edges_x = (self._edges[0][cols.start : cols.stop + 1] - x) * scale
        edges_y = (self._edges[1][rows.start : rows.stop + 1] - y) * scale
        below = _below(footprints[0], edges_x, edges_y, cos * scale, sin * scale)
        for footprint in footprints[1:]:
            below = below + _below(footprint, edges_x, edges_y, cos * scale, sin * scale)
        within = below[1:] - below[:-1]
        share: NDArray[np.float64] = within[:, 1:] - within[:, :-1]
        share *= force
        return Patch(rows, cols, share)


def _below(
    footprint: Footprint, edges_x: NDArray[np.float64], edges_y: NDArray[np.float64], cos: float, sin: float
) -> NDArray[np.float64]:
    """Return the share of the force below and left of each corner of the cells, shape [edges_y, edges_x].

    The edges are in units of the spread; cosine and sine of the object's angle are over the spread [1/m].
    """
    if abs(sin) < _ALIGNED * abs(cos):
        return _aligned(footprint, edges_x, edges_y, cos, cos)
    if abs(cos) < _ALIGNED * abs(sin):
        turned: NDArray[np.float64] = _aligned(footprint, edges_y, edges_x, sin, -sin).T
        return turned
    half_length, half_width, u, u_weight, v, v_weight, mirrored = footprint
    along, across = (half_length * u[: len(u_weight)])[:, None], half_width * v
    x, y = (cos * along - sin * across).ravel(), (sin * along + cos * across).ravel()
    weight = np.multiply.outer(u_weight, v_weight).ravel()
    if mirrored:
        x, y, weight = np.concatenate([x, -x]), np.concatenate([y, -y]), np.concatenate([weight, weight])
    below: NDArray[np.float64] = (normal_below(edges_y[:, None] - y) * weight) @ normal_below(edges_x - x[:, None])
    return below


def _aligned(
    footprint: Footprint,
    edges_u: NDArray[np.float64],
    edges_v: NDArray[np.float64],
    scale_u: float,
    scale_v: float,
) -> NDArray[np.float64]:
    """Return `_below` for an object along the cells, shape [edges_v, edges_u]: both axes apart."""
    half_length, half_width, u, u_weight, v, v_weight, mirrored = footprint
    below_u = normal_below(edges_u - u[:, None] * (half_length * scale_u))
    if mirrored:
        below_u = below_u[: len(u_weight)] + below_u[len(u_weight) :]
    below_v = v_weight @ normal_below(edges_v - v[:, :, None] * (half_width * scale_v))
    if len(v) == 1:
        outer: NDArray[np.float64] = np.multiply.outer(below_v[0], u_weight @ below_u)
        return outer
    below: NDArray[np.float64] = (below_v.T * u_weight) @ below_u
    return below
