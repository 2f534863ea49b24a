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
from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Layout
from posfet_sim.contact.cell_table import NORMAL_END, CellTable, Workspace, cell_table
from posfet_sim.loads import Patch

FINEST_SPREAD: Final = 1 / 50
"""Least spread that `Cells` computes with, as a share of a footprint's half-length; it moves at most 5e-4 of a sphere's
force."""

SPREAD_PER_THICKNESS: Final = 0.70
"""Standard deviation of the Gaussian over the thickness of the cover; see `spread_of_cover`."""

_FINEST_OF_PITCH: Final = 1 / 1000  # least spread as a share of the pitch: it bounds the size of the tables
_AT_ONCE: Final = 16_384  # points times cells that are computed together: they fit into the processor's cache
_ALIGNED: Final = 1e-9  # an object turned by less [rad] counts as along the rows or the columns

Float64Array: TypeAlias = NDArray[np.float64]


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


def window(count: int, pitch: float, low: float, high: float) -> slice:
    """Return which of `count` cells the span from `low` to `high` [m] touches; empty when it misses the array."""
    first, last = math.floor(low / pitch + count / 2), math.ceil(high / pitch + count / 2)
    return slice(max(first, 0), min(last, count))


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
    """Share of the force at each u, shape [n]; below 0 in a part that takes from another."""
    v: NDArray[np.float64]
    """In half-widths, shape [n, m]; [1, m] when the same at each u."""
    v_weight: NDArray[np.float64]
    """Share of that at each v, shape [m]."""
    mirrored: bool
    """Whether weights and v are those of -u, too; v is then symmetric about 0."""


class Cells:
    """The taxels of an array under an elastic cover."""

    def __init__(self, layout: Layout, spread: float) -> None:
        """Take the array and the standard deviation of the cover's spread [m], in [0, 1]."""
        self.spread = real_number("spread", spread, 0, 1)
        self._counts = (layout.cols, layout.rows)
        self._pitch = (layout.pitch_x, layout.pitch_y)
        self._work = Workspace()

    def press(
        self,
        footprints: Sequence[Sequence[Footprint]],
        x: Float64Array,
        y: Float64Array,
        angle: Float64Array,
        force: Float64Array,
    ) -> Patch | None:
        """Return the forces [N] of the taxels under a contact at some moments.

        At each moment the contact has some footprints, lies at (x, y) [m], is turned by `angle` [rad] about z, and
        carries a force [N]; all of length [moments]. Only the taxels within reach (the footprints and 6.5 standard
        deviations) of one of the moments are met; None when there are none.
        """
        half_length = np.array([max([part.half_length for part in parts]) for parts in footprints])
        half_width = np.array([max([part.half_width for part in parts]) for parts in footprints])
        least = max(self.spread, _FINEST_OF_PITCH * min(self._pitch))
        spread = np.maximum(FINEST_SPREAD * np.maximum(half_length, half_width), least)
        cos, sin = np.cos(angle), np.sin(angle)
        reach_x = np.abs(cos) * half_length + np.abs(sin) * half_width + NORMAL_END * spread
        reach_y = np.abs(sin) * half_length + np.abs(cos) * half_width + NORMAL_END * spread
        cols = window(self._counts[0], self._pitch[0], float((x - reach_x).min()), float((x + reach_x).max()))
        rows = window(self._counts[1], self._pitch[1], float((y - reach_y).min()), float((y + reach_y).max()))
        if cols.stop <= cols.start or rows.stop <= rows.start:
            return None
        x = x + (self._counts[0] / 2 - cols.start) * self._pitch[0]  # from the corner of the window on
        y = y + (self._counts[1] / 2 - rows.start) * self._pitch[1]
        share = np.zeros((len(footprints), rows.stop - rows.start, cols.stop - cols.start))
        for width, way, moments in _alike(footprints, spread, cos, sin, max(share.shape[1:])):
            cells = _Tables(cell_table(self._pitch[0], width), cell_table(self._pitch[1], width), self._work)
            where = _Where(x[moments], y[moments], cos[moments], sin[moments])
            for parts in zip(*[footprints[moment] for moment in moments], strict=True):
                share[moments] += _COLLECT[way](_stack(parts), where, cells, share.shape[1:])
        share *= force[:, None, None]
        return Patch(rows, cols, share)


class _Way(IntEnum):
    """How an object lies on the cells."""

    ALONG = 0
    ACROSS = 1
    ASKEW = 2


class _Tables(NamedTuple):
    """The cells along x and y."""

    x: CellTable
    y: CellTable
    work: Workspace


class _Where(NamedTuple):
    """Where a contact lies at some moments, from the corner of the first cell on, each of shape [moments]."""

    x: Float64Array
    y: Float64Array
    cos: Float64Array
    sin: Float64Array


def _alike(
    footprints: Sequence[Sequence[Footprint]], spread: Float64Array, cos: Float64Array, sin: Float64Array, cells: int
) -> Iterator[tuple[float, _Way, list[int]]]:
    """Yield spread, way and numbers of moments that are computed together: with the same points, and not too many."""
    alike: dict[tuple[Any, ...], list[int]] = {}
    along, across = np.abs(cos), np.abs(sin)
    ways = np.where(across < _ALIGNED * along, _Way.ALONG, np.where(along < _ALIGNED * across, _Way.ACROSS, _Way.ASKEW))
    for moment, (parts, width, way) in enumerate(zip(footprints, spread.tolist(), ways.tolist(), strict=True)):
        key: tuple[Any, ...] = (width, way)
        for part in parts:
            key += (part.u.shape, part.v.shape, id(part.v_weight), part.mirrored)
        alike.setdefault(key, []).append(moment)
    for (width, way, *_), moments in alike.items():
        parts = footprints[moments[0]]
        points = max([part.u.size * part.v_weight.size if way == _Way.ASKEW else part.v.size for part in parts])
        count = max(_AT_ONCE // (points * cells), 1)
        for begin in range(0, len(moments), count):
            yield width, way, moments[begin : begin + count]


class _Stack(NamedTuple):
    """Footprints of some moments with the same points, those of one moment side by side.

    What does not differ has 1 for the number of moments.
    """

    half_length: Float64Array
    """Shape [moments, 1]."""
    half_width: Float64Array
    """Shape [moments, 1, 1]."""
    u: Float64Array
    """Shape [moments, n], or [moments, 2*n] when mirrored."""
    u_weight: Float64Array
    """Shape [moments, n]."""
    v: Float64Array
    """Shape [moments, n or 1, m]."""
    v_weight: Float64Array
    """Shape [m]."""
    mirrored: bool


def _stack(parts: Sequence[Footprint]) -> _Stack:
    lengths, widths, u, u_weight, v, v_weight, mirrored = zip(*parts, strict=True)
    return _Stack(
        np.array(lengths)[:, None],
        np.array(widths)[:, None, None],
        _side_by_side(u),
        _side_by_side(u_weight),
        _side_by_side(v),
        v_weight[0],
        mirrored[0],
    )


def _side_by_side(arrays: Sequence[Float64Array]) -> Float64Array:
    first = arrays[0]
    return first[None] if all(array is first for array in arrays) else np.stack(arrays)


def _along(stack: _Stack, where: _Where, cells: _Tables, shape: tuple[int, ...]) -> Float64Array:
    """Return the shares of the cells, shape [moments, rows, cols], under an object along x: both axes apart."""
    u = where.x[:, None] + where.cos[:, None] * stack.half_length * stack.u
    v = where.y[:, None, None] + where.cos[:, None, None] * stack.half_width * stack.v
    u, v = cells.x.collect(u, shape[1], cells.work), cells.y.collect(v, shape[0], cells.work)
    if stack.mirrored:
        points = stack.u_weight.shape[1]
        u = u[..., :points] + u[..., points:]
    u *= stack.u_weight
    if v.shape[2] == 1:
        u = u.sum(axis=2, keepdims=True)
    v = (v.reshape(-1, v.shape[3]) @ stack.v_weight).reshape(v.shape[:3])
    share: Float64Array = v.transpose(1, 0, 2) @ u.transpose(1, 2, 0)
    return share


def _across(stack: _Stack, where: _Where, cells: _Tables, shape: tuple[int, ...]) -> Float64Array:
    """Return the same under an object along y: as seen by cells that are turned back by a right angle."""
    turned = _Where(where.y, where.x, where.sin, where.cos)
    stack = stack._replace(v=-stack.v)
    share: Float64Array = _along(stack, turned, _Tables(cells.y, cells.x, cells.work), shape[::-1]).transpose(0, 2, 1)
    return share


def _askew(stack: _Stack, where: _Where, cells: _Tables, shape: tuple[int, ...]) -> Float64Array:
    """Return the same under an object at any angle."""
    points = stack.u_weight.shape[1]
    u, v = (stack.half_length * stack.u[:, :points])[:, :, None], stack.half_width * stack.v
    cos, sin = where.cos[:, None, None], where.sin[:, None, None]
    x, y = ((cos * u - sin * v), (sin * u + cos * v))
    x, y = x.reshape(len(x), -1), y.reshape(len(y), -1)
    weight = stack.u_weight[:, :, None] * stack.v_weight
    weight = weight.reshape(len(weight), -1)
    if stack.mirrored:
        x, y = np.concatenate([x, -x], axis=1), np.concatenate([y, -y], axis=1)
        weight = np.concatenate([weight, weight], axis=1)
    within_x = cells.x.collect(where.x[:, None] + x, shape[1], cells.work)
    within_y = cells.y.collect(where.y[:, None] + y, shape[0], cells.work)
    within_y *= weight
    share: Float64Array = within_y.transpose(1, 0, 2) @ within_x.transpose(1, 2, 0)
    return share


_COLLECT: Final = {_Way.ALONG: _along, _Way.ACROSS: _across, _Way.ASKEW: _askew}
