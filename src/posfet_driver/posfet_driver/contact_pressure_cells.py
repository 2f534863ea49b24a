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
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.loads import Patch
from posfet_model.checks import real_number
from posfet_model.sensor import Layout

FINEST_SPREAD: Final = 1 / 50
"""Least spread that `Cells` computes with, as a share of a footprint's half-length; it moves at most 2e-3 of the force
over the edge of a cell."""

SPREAD_PER_THICKNESS: Final = 0.70
"""Standard deviation of the Gaussian over the thickness of the cover; see `spread_of_cover`."""

NORMAL_END: Final = 6.5
"""Reach of the Gaussian in standard deviations: 1 - Phi(6.5) = 4e-11 is set to 0, so that every force is shared out
without rest."""

_NORMAL_STEP: Final = 1 / 512  # linear interpolation is then right to step^2/8 * max|phi'| = 1.2e-7
_NORMAL_GRID: Final = np.arange(-NORMAL_END, NORMAL_END + _NORMAL_STEP / 2, _NORMAL_STEP)
_NORMAL: Final = np.array([0.5 * math.erfc(-z / math.sqrt(2)) for z in _NORMAL_GRID])
_NORMAL[[0, -1]] = 0.0, 1.0
_ALIGNED: Final = 1e-9  # an object turned by less [rad] counts as along the rows or the columns


def spread_of_cover(thickness: float) -> float:
    """Return the standard deviation of the Gaussian [m] that stands for a cover of a thickness h [m], in [0, 0.1].

    ``s = 0.70*h``: of all Gaussians the one whose shares of a point force on cells of 1.5 h to 2 h come nearest to
    those of an elastic half-space, in which the force F gives at depth h the normal stress
    ``3*F*h^3/(2*pi*(r^2 + h^2)^(5/2))`` (Boussinesq; Johnson, Contact Mechanics, 1985, eq. 3.19).

    Notes
    -----
    A cell's share of a point force is off by up to 0.037 of the force (0.061 for cells of 1 h or 2.5 h); that of a wide
    contact by less. The half-space's wide tails are left out. A cover bonded to a stiff chip is no half-space; both are
    approximations.
    """
    return SPREAD_PER_THICKNESS * real_number("thickness", thickness, 0, 0.1)


def normal_below(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard normal distribution function, right to 1.2e-7; exactly 0 and 1 beyond +-6.5."""
    values: NDArray[np.float64] = np.interp(z, _NORMAL_GRID, _NORMAL)
    return values


def cell_edges(count: int, pitch: float) -> NDArray[np.float64]:
    """Return the limits of the cells along one axis [m], shape [count + 1], the array's middle at 0."""
    return (np.arange(count + 1, dtype=np.float64) - count / 2) * pitch


def window(edges: NDArray[np.float64], pitch: float, centre: float, reach: float) -> slice:
    """Return the cells that [centre - reach, centre + reach] touches; empty when it misses the array."""
    first = math.floor((centre - reach - edges[0]) / pitch)
    last = math.ceil((centre + reach - edges[0]) / pitch)
    return slice(max(first, 0), min(last, len(edges) - 1))


def points_for(extent: float, spread: float, widest: float) -> int:
    """Return how many points a pressure needs over a half-length `extent` [m], even: ``2*ceil(extent/s) + 2``.

    `widest` [m] is the greatest half-length of the footprint. A cell's share is then right to 3e-6 (found by comparison
    with twice as many).
    """
    return 2 * math.ceil(extent / max(spread, FINEST_SPREAD * widest)) + 2


@dataclass(frozen=True)
class Footprint:
    """Where and how a contact presses, as weighted points (u_i, v_ij) in the frame of the object."""

    u: NDArray[np.float64]
    """[m], shape [n]."""
    u_weight: NDArray[np.float64]
    """Share of the force at each u, shape [n]."""
    v: NDArray[np.float64]
    """[m], shape [n, m]; [1, m] when the same at each u."""
    v_weight: NDArray[np.float64]
    """Shape [m]; sums to 1."""
    mirrored: bool
    """Whether each u stands for -u, too, with the same weight; v is then symmetric about 0."""
    half_length: float
    """Greatest distance of u from 0 [m]."""
    half_width: float
    """Greatest distance of v from 0 [m]."""


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
        half_length = max(footprint.half_length for footprint in footprints)
        half_width = max(footprint.half_width for footprint in footprints)
        spread = max(self.spread, FINEST_SPREAD * max(half_length, half_width))
        reach_x = abs(cos) * half_length + abs(sin) * half_width + NORMAL_END * spread
        reach_y = abs(sin) * half_length + abs(cos) * half_width + NORMAL_END * spread
        cols = window(self._edges[0], self._pitch[0], x, reach_x)
        rows = window(self._edges[1], self._pitch[1], y, reach_y)
        if cols.stop <= cols.start or rows.stop <= rows.start:
            return None
        edges_x = (self._edges[0][cols.start : cols.stop + 1] - x) / spread
        edges_y = (self._edges[1][rows.start : rows.stop + 1] - y) / spread
        shares = [_shares(footprint, edges_x, edges_y, cos, sin, spread) for footprint in footprints]
        share: NDArray[np.float64] = shares[0] if len(shares) == 1 else np.sum(shares, axis=0)
        return Patch(rows, cols, force * share)


def _shares(
    footprint: Footprint,
    edges_x: NDArray[np.float64],
    edges_y: NDArray[np.float64],
    cos: float,
    sin: float,
    spread: float,
) -> NDArray[np.float64]:
    """Return each cell's share of the force, shape [rows, cols]; edges in units of the spread."""
    if abs(sin) < _ALIGNED:
        return _aligned(footprint, edges_x, edges_y, cos / spread, cos / spread)
    if abs(cos) < _ALIGNED:
        turned: NDArray[np.float64] = _aligned(footprint, edges_y, edges_x, sin / spread, -sin / spread).T
        return turned
    u, v = footprint.u[:, None] / spread, footprint.v / spread
    weight = np.multiply.outer(footprint.u_weight, footprint.v_weight)
    x, y = (cos * u - sin * v).ravel(), (sin * u + cos * v).ravel()
    within_x = _within(edges_x, x)
    within_y = _within(edges_y, y) * weight.reshape(-1, 1)
    shares: NDArray[np.float64] = within_y.T @ within_x
    if footprint.mirrored:
        shares += (_within(edges_y, -y) * weight.reshape(-1, 1)).T @ _within(edges_x, -x)
    return shares


def _aligned(
    footprint: Footprint,
    edges_u: NDArray[np.float64],
    edges_v: NDArray[np.float64],
    scale_u: float,
    scale_v: float,
) -> NDArray[np.float64]:
    """Return the shares, shape [cells along v, cells along u]: both axes apart, and v once when it is the same."""
    u = footprint.u[:, None] * scale_u
    below_u = normal_below(edges_u - u)
    if footprint.mirrored:
        below_u += normal_below(edges_u + u)
    below_v = footprint.v_weight @ normal_below(edges_v - footprint.v[:, :, None] * scale_v)
    within_u = below_u[:, 1:] - below_u[:, :-1]
    within_v = below_v[:, 1:] - below_v[:, :-1]
    if len(within_v) == 1:
        outer: NDArray[np.float64] = np.multiply.outer(within_v[0], footprint.u_weight @ within_u)
        return outer
    shares: NDArray[np.float64] = (within_v * footprint.u_weight[:, None]).T @ within_u
    return shares


def _within(edges: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how much of a Gaussian about each centre lies in each cell, shape [centres, cells]."""
    below = normal_below(edges - centres[:, None])
    within: NDArray[np.float64] = below[:, 1:] - below[:, :-1]
    return within
