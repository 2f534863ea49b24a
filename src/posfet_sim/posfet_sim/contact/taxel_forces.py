# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces on the taxels from a contact pressure: spread by the elastomer skin, and integrated over the cells.

**Force on a taxel.** The area of a taxel (1 mm2 on the shipped chip) is smaller than its cell (pitch times pitch,
2.25 mm2). The elastomer skin is assumed to transmit the load of the whole cell to its taxel: the *force on a taxel* is
the force on its cell, and the forces on all taxels sum to the force on the array. Load outside the outermost cells is
lost.

**Elastomer skin.** The skin blurs the pressure with a Gaussian of standard deviation s (assumed shape), which preserves
total force and centre of pressure. The subsurface stress of an elastic half-space (Boussinesq) has a sharper peak and
wider tails; `skin_spread` gives the best Gaussian.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array
from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Layout
from posfet_sim.contact.cell_table import GAUSSIAN_REACH, CellTable, Workspace, cell_table
from posfet_sim.loads import Patch

MIN_RELATIVE_SPREAD: Final = 1 / 50
"""Minimum spread in `Cells` relative to the half-length of a footprint [1]; it displaces at most 5e-4 of the force of a
sphere."""

SPREAD_PER_THICKNESS: Final = 0.70
"""Standard deviation of the Gaussian over the thickness of the elastomer skin [1]; see `skin_spread`."""

_MIN_SPREAD_PER_PITCH: Final = 1 / 1000  # bounds the size of the tables
_BATCH_SIZE: Final = 16_384  # points times cells computed at once: they fit into the processor's cache
_ALIGNED: Final = 1e-9  # rotation [rad] below which an object is aligned with the rows or the columns


def skin_spread(thickness: float) -> float:
    """Return the standard deviation s of the Gaussian for an elastomer skin of a thickness h.

    ``s = 0.70*h``: of all Gaussians, its fractions of a point force on cells of 1.5 h to 2 h are closest to those of an
    elastic half-space, in which the force F causes the normal stress ``3*F*h^3/(2*pi*(r^2 + h^2)^(5/2))`` at depth h
    (Boussinesq; Johnson, Contact Mechanics, 1985, section 3.2).

    Parameters
    ----------
    thickness : float
        Thickness h [m], in [0, 0.1].

    Returns
    -------
    float
        Standard deviation s [m].

    Raises
    ------
    ValueError
        The thickness is out of range.

    Notes
    -----
    The fraction of a point force on a cell has an error of up to 0.037 (0.061 for cells of 1 h or 2.5 h); that of a
    wide contact of less. The wide tails of the half-space are neglected. A skin bonded to a stiff chip is no half-space
    either; both are approximations.
    """
    return SPREAD_PER_THICKNESS * real_number("thickness", thickness, 0, 0.1)


def window(count: int, pitch: float, low: float, high: float) -> slice:
    """Return the cells that overlap an interval.

    Parameters
    ----------
    count : int
        Number of cells in a row, centred on 0.
    pitch : float
        Width of a cell [m].
    low, high : float
        Ends of the interval [m].

    Returns
    -------
    slice
        The cells; empty when the interval is outside the array.
    """
    first, last = math.floor(low / pitch + count / 2), math.ceil(high / pitch + count / 2)
    return slice(max(first, 0), min(last, count))


def points_for(extent: float, spread: float, widest: float) -> int:
    """Return the number of quadrature points over a half-length, an even number: ``2*ceil(extent/s) + 2``.

    The fraction of the force on a cell then has an error of 3e-6 (found by comparison with twice as many points).

    Parameters
    ----------
    extent : float
        Half-length [m].
    spread : float
        Standard deviation s of the spread [m].
    widest : float
        Largest half-length of the footprint [m].
    """
    return 2 * math.ceil(extent / max(spread, MIN_RELATIVE_SPREAD * widest)) + 2


class Footprint(NamedTuple):
    """A contact pressure as weighted points (u_i, v_ij) in the frame of the object.

    A tuple, as one is created for each object and scan.
    """

    half_length: float
    """Maximum of abs(u) [m]."""
    half_width: float
    """Maximum of abs(v) [m]."""
    u: NDArray[np.float64]
    """u in half-lengths [1], shape [n]; with `mirrored` [2*n], the second half -1 times the first."""
    u_weight: NDArray[np.float64]
    """Fraction of the force at each u [1], shape [n]; may be negative in one of several footprints."""
    v: NDArray[np.float64]
    """v in half-widths [1], shape [n, m]; [1, m] when the same at each u."""
    v_weight: NDArray[np.float64]
    """Fraction of that at each v [1], shape [m]."""
    mirrored: bool
    """Whether weights and v apply to -u, too; v is then symmetric about 0."""


class Cells:
    """The cells of an array under an elastomer skin.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    spread : float
        Standard deviation of the spread by the skin [m], in [0, 1].

    Raises
    ------
    ValueError
        The spread is out of range.
    """

    def __init__(self, layout: Layout, spread: float) -> None:
        self.spread = real_number("spread", spread, 0, 1)
        """Standard deviation of the spread [m]."""
        self._counts = (layout.cols, layout.rows)
        self._pitch = (layout.pitch_x, layout.pitch_y)
        self._work = Workspace()

    def press(
        self,
        footprints: Sequence[Sequence[Footprint]],
        x: Array,
        y: Array,
        angle: Array,
        force: Array,
    ) -> Patch | None:
        """Return the forces on the taxels under a contact at several samples.

        Parameters
        ----------
        footprints : sequence of sequence of Footprint
            Pressure at each sample, as the sum of several footprints.
        x, y : numpy.ndarray
            Position of the contact [m], shape [samples].
        angle : numpy.ndarray
            Rotation about z [rad], shape [samples].
        force : numpy.ndarray
            Normal force [N], shape [samples].

        Returns
        -------
        Patch or None
            Forces on the taxels within reach (the footprints and 6.5 standard deviations) of one of the samples; None
            when there are none.
        """
        half_length = np.array([max(part.half_length for part in parts) for parts in footprints])
        half_width = np.array([max(part.half_width for part in parts) for parts in footprints])
        smallest = max(self.spread, _MIN_SPREAD_PER_PITCH * min(self._pitch))
        spread = np.maximum(MIN_RELATIVE_SPREAD * np.maximum(half_length, half_width), smallest)
        cos, sin = np.cos(angle), np.sin(angle)
        reach_x = np.abs(cos) * half_length + np.abs(sin) * half_width + GAUSSIAN_REACH * spread
        reach_y = np.abs(sin) * half_length + np.abs(cos) * half_width + GAUSSIAN_REACH * spread
        cols = window(self._counts[0], self._pitch[0], float((x - reach_x).min()), float((x + reach_x).max()))
        rows = window(self._counts[1], self._pitch[1], float((y - reach_y).min()), float((y + reach_y).max()))
        if cols.stop <= cols.start or rows.stop <= rows.start:
            return None
        x = x + (self._counts[0] / 2 - cols.start) * self._pitch[0]  # from the corner of the window
        y = y + (self._counts[1] / 2 - rows.start) * self._pitch[1]
        fraction = np.zeros((len(footprints), rows.stop - rows.start, cols.stop - cols.start))
        for width, orientation, samples in _batches(footprints, spread, cos, sin, max(fraction.shape[1:])):
            cells = _Tables(cell_table(self._pitch[0], width), cell_table(self._pitch[1], width), self._work)
            placement = _Placement(x[samples], y[samples], cos[samples], sin[samples])
            for parts in zip(*[footprints[sample] for sample in samples], strict=True):
                fraction[samples] += _COLLECT[orientation](_stack(parts), placement, cells, fraction.shape[1:])
        fraction *= force[:, None, None]
        return Patch(rows, cols, fraction)


class _Orientation(IntEnum):
    """Orientation of an object against the cells."""

    ALONG_X = 0
    ALONG_Y = 1
    ROTATED = 2


class _Tables(NamedTuple):
    """The cells along x and y."""

    x: CellTable
    y: CellTable
    work: Workspace


class _Placement(NamedTuple):
    """Position from the corner of the first cell, and rotation, at several samples; each of shape [samples]."""

    x: Array
    y: Array
    cos: Array
    sin: Array


def _batches(
    footprints: Sequence[Sequence[Footprint]], spread: Array, cos: Array, sin: Array, cells: int
) -> Iterator[tuple[float, _Orientation, list[int]]]:
    """Yield spread, orientation and samples that are computed at once: with equal points, and limited in number."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    along, across = np.abs(cos), np.abs(sin)
    aligned_y = np.where(along < _ALIGNED * across, _Orientation.ALONG_Y, _Orientation.ROTATED)
    orientations = np.where(across < _ALIGNED * along, _Orientation.ALONG_X, aligned_y)
    samples_of = zip(footprints, spread.tolist(), orientations.tolist(), strict=True)
    for sample, (parts, width, orientation) in enumerate(samples_of):
        key: tuple[Any, ...] = (width, orientation)
        for part in parts:
            key += (part.u.shape, part.v.shape, id(part.v_weight), part.mirrored)
        groups.setdefault(key, []).append(sample)
    for (width, orientation, *_), samples in groups.items():
        parts = footprints[samples[0]]
        rotated = orientation == _Orientation.ROTATED
        points = max(part.u.size * part.v_weight.size if rotated else part.v.size for part in parts)
        count = max(_BATCH_SIZE // (points * cells), 1)
        for begin in range(0, len(samples), count):
            yield width, orientation, samples[begin : begin + count]


class _Stack(NamedTuple):
    """Footprints of several samples with equal points, stacked; equal arrays have 1 for the number of samples."""

    half_length: Array
    """Shape [samples, 1]."""
    half_width: Array
    """Shape [samples, 1, 1]."""
    u: Array
    """Shape [samples, n], or [samples, 2*n] when mirrored."""
    u_weight: Array
    """Shape [samples, n]."""
    v: Array
    """Shape [samples, n or 1, m]."""
    v_weight: Array
    """Shape [m]."""
    mirrored: bool


def _stack(parts: Sequence[Footprint]) -> _Stack:
    lengths, widths, u, u_weight, v, v_weight, mirrored = zip(*parts, strict=True)
    return _Stack(
        np.array(lengths)[:, None],
        np.array(widths)[:, None, None],
        _stacked(u),
        _stacked(u_weight),
        _stacked(v),
        v_weight[0],
        mirrored[0],
    )


def _stacked(arrays: Sequence[Array]) -> Array:
    first = arrays[0]
    return first[None] if all(array is first for array in arrays) else np.stack(arrays)


def _along_x(stack: _Stack, placement: _Placement, cells: _Tables, shape: tuple[int, ...]) -> Array:
    """Return the fractions on the cells, shape [samples, rows, cols], of an object along x: the axes separate."""
    u = placement.x[:, None] + placement.cos[:, None] * stack.half_length * stack.u
    v = placement.y[:, None, None] + placement.cos[:, None, None] * stack.half_width * stack.v
    u, v = cells.x.collect(u, shape[1], cells.work), cells.y.collect(v, shape[0], cells.work)
    if stack.mirrored:
        points = stack.u_weight.shape[1]
        u = u[..., :points] + u[..., points:]
    u *= stack.u_weight
    if v.shape[2] == 1:
        u = u.sum(axis=2, keepdims=True)
    v = (v.reshape(-1, v.shape[3]) @ stack.v_weight).reshape(v.shape[:3])
    fraction: Array = v.transpose(1, 0, 2) @ u.transpose(1, 2, 0)
    return fraction


def _along_y(stack: _Stack, placement: _Placement, cells: _Tables, shape: tuple[int, ...]) -> Array:
    """Return the same for an object along y: as for an object along x on transposed cells."""
    turned = _Placement(placement.y, placement.x, placement.sin, placement.cos)
    stack = stack._replace(v=-stack.v)
    transposed = _Tables(cells.y, cells.x, cells.work)
    fraction: Array = _along_x(stack, turned, transposed, shape[::-1]).transpose(0, 2, 1)
    return fraction


def _rotated(stack: _Stack, placement: _Placement, cells: _Tables, shape: tuple[int, ...]) -> Array:
    """Return the same for an object at any angle."""
    points = stack.u_weight.shape[1]
    u, v = (stack.half_length * stack.u[:, :points])[:, :, None], stack.half_width * stack.v
    cos, sin = placement.cos[:, None, None], placement.sin[:, None, None]
    x, y = ((cos * u - sin * v), (sin * u + cos * v))
    x, y = x.reshape(len(x), -1), y.reshape(len(y), -1)
    weight = stack.u_weight[:, :, None] * stack.v_weight
    weight = weight.reshape(len(weight), -1)
    if stack.mirrored:
        x, y = np.concatenate([x, -x], axis=1), np.concatenate([y, -y], axis=1)
        weight = np.concatenate([weight, weight], axis=1)
    within_x = cells.x.collect(placement.x[:, None] + x, shape[1], cells.work)
    within_y = cells.y.collect(placement.y[:, None] + y, shape[0], cells.work)
    within_y *= weight
    fraction: Array = within_y.transpose(1, 0, 2) @ within_x.transpose(1, 2, 0)
    return fraction


_COLLECT: Final = {_Orientation.ALONG_X: _along_x, _Orientation.ALONG_Y: _along_y, _Orientation.ROTATED: _rotated}
