# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts of the independent plant: pressures of objects, what a cover makes of them, and scenes over time.

The force on a taxel is the normal stress below the cover, integrated over the taxel's cell: the square of the pitch
around its centre, as the stack understands the force of a taxel. Covers are linear, and the same everywhere::

    stress = pressure * kernel,    kernel = inverse transform of H(k),  H(0) = 1

===========  ========================  =============================================================================
cover        H(k)                      meaning
===========  ========================  =============================================================================
gauss        exp(-(k*s)^2/2)           what the sensor file says, with its `contact_spread_mm` s
layer        1/cosh(k*h)               thin layer that is bonded to the chip: exponential tails
half_space   (1 + k*h)*exp(-k*h)       stress at the depth h of an elastic half space (Boussinesq): tails as r^-5
===========  ========================  =============================================================================

h is such that a cell gets the same share of a point load at its centre as by the sensor file: a user who measures the
spread with a needle finds that. Friction moves the centre of a contact but is no normal stress; it is not modelled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from independent.film import Array, Load
from posfet_model.sensor.description import Sensor

CoverName: TypeAlias = Literal["gauss", "layer", "half_space"]
COVERS: Final[tuple[CoverName, ...]] = get_args(CoverName)

GRID: Final = 512
"""Points of the grid along each axis."""
SPACING: Final = 0.05e-3
"""Distance of the points [m]: a tenth of a spread."""
FINE: Final = 4
"""Points of a pressure per point of the grid along each axis."""
HERTZ_FORCES: Final = (0.0, 0.01, 0.05, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0)
"""Forces for which the pressure under a round object is computed [N]; in between it is interpolated over the radius."""
PATH_STEP: Final = 4
"""Scans between which the shares of a moving contact are interpolated."""

Pressure: TypeAlias = Callable[[Array, Array, float], Array]
"""Pressure at x, y [m], of any scale, for a force [N]."""


@dataclass(frozen=True)
class Shape:
    """What presses: its pressure in its own frame."""

    pressure: Pressure
    """Pressure at x, y [m] for a force [N], of any scale."""
    reach: float
    """Greatest distance from the middle at which it is not 0 [m]."""
    forces: tuple[float, ...] = (1.0,)
    """Forces for which it is computed [N]; one: the pressure has the same shape for every force."""


def sphere(radius: float, modulus: float = 4e6) -> Shape:
    """Return a ball or fingertip, with the pressure of Hertz.

    Parameters
    ----------
    radius : float
        Radius [m].
    modulus : float, default 4e6
        Effective modulus of ball and cover [Pa], assumed: silicone of Shore A 40.

    Returns
    -------
    Shape
        The shape.
    """

    def pressure(x: Array, y: Array, force: float) -> Array:
        contact = max(_hertz_radius(force, radius, modulus), SPACING)
        inside: Array = np.sqrt(np.maximum(1.0 - (x * x + y * y) / contact**2, 0.0))
        return inside

    reach = max(_hertz_radius(HERTZ_FORCES[-1], radius, modulus), SPACING)
    return Shape(pressure, reach, HERTZ_FORCES)


def rectangle(width: float, height: float, angle: float = 0.0) -> Shape:
    """Return a flat soft pad with an even pressure.

    Parameters
    ----------
    width : float
        Size along x [m].
    height : float
        Size along y [m].
    angle : float, default 0.0
        Rotation from x towards y [rad].
    """

    def pressure(x: Array, y: Array, force: float) -> Array:
        along, across = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
        return np.where((np.abs(along) <= 0.5 * width) & (np.abs(across) <= 0.5 * height), 1.0, 0.0)

    return Shape(pressure, 0.5 * math.hypot(width, height))


def rigid_punch(width: float, height: float) -> Shape:
    """Return a flat rigid punch: the pressure rises towards its rim.

    The pressure of a strip, ``1/sqrt(1 - (x/a)^2)``, along both axes; the rim itself, where it is infinite, is cut
    off at a twentieth of the half width.

    Parameters
    ----------
    width : float
        Size along x [m].
    height : float
        Size along y [m].
    """

    def pressure(x: Array, y: Array, force: float) -> Array:
        result = np.ones(np.broadcast_shapes(x.shape, y.shape))
        for place, size in ((x, width), (y, height)):
            share = np.abs(place) / (0.5 * size)
            result = result * np.where(share <= 1.0, 1.0 / np.sqrt(1.0 - np.minimum(share, 0.95) ** 2), 0.0)
        return result

    return Shape(pressure, 0.5 * math.hypot(width, height))


def ring(outer: float, inner: float) -> Shape:
    """Return a hollow cylinder with an even pressure.

    Parameters
    ----------
    outer : float
        Outer radius [m].
    inner : float
        Inner radius [m].
    """

    def pressure(x: Array, y: Array, force: float) -> Array:
        distance = np.hypot(x, y)
        return np.where((distance <= outer) & (distance >= inner), 1.0, 0.0)

    return Shape(pressure, outer)


def ridges(count: int, distance: float, width: float, length: float) -> Shape:
    """Return parallel ridges along y, each with the pressure of a cylinder.

    Parameters
    ----------
    count : int
        Number of ridges.
    distance : float
        Distance between them [m].
    width : float
        Width of the contact of each [m].
    length : float
        Their length [m].
    """
    middles = (np.arange(count) - 0.5 * (count - 1)) * distance

    def pressure(x: Array, y: Array, force: float) -> Array:
        across = sum(np.sqrt(np.maximum(1.0 - ((x - middle) / (0.5 * width)) ** 2, 0.0)) for middle in middles)
        return np.where(np.abs(y) <= 0.5 * length, across, 0.0)

    return Shape(pressure, math.hypot(0.5 * length, middles[-1] + 0.5 * width))


class Cover:
    """Forces on the taxels of pressures on a cover.

    Parameters
    ----------
    sensor : Sensor
        Sensor file.
    name : str
        gauss, layer or half_space.
    """

    def __init__(self, sensor: Sensor, name: CoverName) -> None:
        self.name: CoverName = name
        self.positions = sensor.layout.positions
        """Centres of the taxels [m], shape [taxels, 2]."""
        self._pitch = sensor.layout.pitch_x, sensor.layout.pitch_y
        self._spread = sensor.device.contact_spread
        self._maps: dict[Shape, tuple[Array, Array]] = {}

    @cached_property
    def depth(self) -> float:
        """Depth h of the cover, or its standard deviation s [m]."""
        if self.name == "gauss":
            return self._spread
        wanted = math.prod(math.erf(pitch / (2.0 * math.sqrt(2.0) * self._spread)) for pitch in self._pitch)
        low, high = 0.1 * self._spread, 4.0 * self._spread
        for _ in range(40):
            depth = 0.5 * (low + high)
            low, high = (depth, high) if self._centre_share(depth) > wanted else (low, depth)
        return 0.5 * (low + high)

    def shares(self, shape: Shape, x: Array, y: Array, force: Array) -> Array:
        """Return the share of the force of an object that each taxel gets.

        Parameters
        ----------
        shape : Shape
            The object.
        x : ndarray of float64, shape [times]
            Place of its middle along the columns [m].
        y : ndarray of float64, shape [times]
            The same along the rows [m].
        force : ndarray of float64, shape [times]
            Force [N].

        Returns
        -------
        ndarray of float64, shape [times, taxels]
            Shares [1].
        """
        if shape not in self._maps:
            self._maps[shape] = self._compute(shape)
        sizes, maps = self._maps[shape]
        size = np.interp(np.cbrt(force), sizes, np.arange(len(sizes)))
        level = np.minimum(size.astype(np.intp), max(len(sizes) - 2, 0))
        part = (size - level)[:, None]
        column = (self.positions[:, 0] - x[:, None]) / SPACING + GRID // 2
        row = (self.positions[:, 1] - y[:, None]) / SPACING + GRID // 2
        result = (1.0 - part) * _bilinear(maps, level, row, column)
        if len(sizes) > 1:
            result += part * _bilinear(maps, level + 1, row, column)
        return result

    def _transfer(self, depth: float) -> Array:
        """Return H(k), times that of the cell, on the grid of transforms."""
        k_x, k_y = 2.0 * math.pi * np.fft.rfftfreq(GRID, SPACING), 2.0 * math.pi * np.fft.fftfreq(GRID, SPACING)
        k = np.hypot(k_x[None, :], k_y[:, None]) * depth
        if self.name == "gauss":
            cover = np.exp(-0.5 * k * k)
        elif self.name == "layer":
            cover = 1.0 / np.cosh(np.minimum(k, 700.0))
        else:
            cover = (1.0 + k) * np.exp(-k)
        cell_x, cell_y = (
            each * np.sinc(wave * each / (2.0 * math.pi))
            for each, wave in zip(self._pitch, (k_x[None, :], k_y[:, None]), strict=True)
        )
        transfer: Array = cover * cell_x * cell_y / SPACING**2
        return transfer

    def _centre_share(self, depth: float) -> float:
        """Return the share of a point load at its centre that a cell gets."""
        weights = np.full(GRID // 2 + 1, 2.0)
        weights[[0, -1]] = 1.0
        return float((self._transfer(depth) * weights).sum()) / GRID**2

    def _compute(self, shape: Shape) -> tuple[Array, Array]:
        """Return cube roots of the forces, and for each the share of a taxel by its place from the object."""
        transfer = self._transfer(self.depth)
        half = int(shape.reach / SPACING) + 2
        place = (np.arange((2 * half + 1) * FINE) + 0.5) / FINE - half - 0.5
        near = slice(GRID // 2 - half, GRID // 2 + half + 1)
        maps = np.empty((len(shape.forces), GRID, GRID))
        for index, force in enumerate(shape.forces):
            fine = shape.pressure(place[None, :] * SPACING, place[:, None] * SPACING, force)
            coarse = fine.reshape(2 * half + 1, FINE, 2 * half + 1, FINE).sum(axis=(1, 3))
            grid = np.zeros((GRID, GRID))
            grid[near, near] = coarse / coarse.sum()
            maps[index] = np.fft.irfft2(np.fft.rfft2(grid) * transfer, s=(GRID, GRID))
        return np.cbrt(np.array(shape.forces)), maps


@lru_cache(maxsize=4)
def cover_of(sensor: Sensor, name: CoverName) -> Cover:
    """Return a cover, which keeps what it has computed.

    Parameters
    ----------
    sensor : Sensor
        Sensor file.
    name : str
        gauss, layer or half_space.
    """
    return Cover(sensor, name)


Knots: TypeAlias = Sequence[tuple[float, float]]
"""Times [s] and values; in between they follow a half cosine, before and after they stay."""


def course(knots: Knots, time: Array) -> Array:
    """Return values that move smoothly from knot to knot.

    Parameters
    ----------
    knots : sequence of (float, float)
        Times [s], ascending, and values.
    time : ndarray of float64, shape [scans]
        Times [s].

    Returns
    -------
    ndarray of float64, shape [scans]
        Values.
    """
    times, values = (np.array(each) for each in zip(*knots, strict=True))
    if len(times) == 1:
        return np.full(len(time), values[0])
    index = np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2)
    part = np.clip((time - times[index]) / (times[index + 1] - times[index]), 0.0, 1.0)
    moved: Array = values[index] + (values[index + 1] - values[index]) * 0.5 * (1.0 - np.cos(math.pi * part))
    return moved


@dataclass(frozen=True)
class Touch:
    """One object over time."""

    shape: Shape
    force: Knots
    """Force [N]."""
    x: Knots = ((0.0, 0.0),)
    """Place of its middle along the columns [m]."""
    y: Knots = ((0.0, 0.0),)
    """The same along the rows [m]."""
    tremor: tuple[float, float] = (0.0, 0.0)
    """Amplitude relative to the force [1], and frequency [Hz], of a tremor."""
    wander: float = 0.0
    """Standard deviation of slow random changes of the force, relative to it, with a correlation time of 5 s [1]."""


@dataclass(frozen=True)
class Scene:
    """What happens to the array."""

    name: str
    duration: float
    """[s]; at least 5 s after the last release."""
    touches: tuple[Touch, ...]
    chip: Knots = ((0.0, 0.0),)
    """Chip temperature relative to its start [K], linear from knot to knot."""
    starts: float = 0.0
    """Time from which the board sends [s]; where that is not 0, something touches already."""
    sharp: bool = False
    """Whether every scan is judged, as within milliseconds; else one in ten."""

    def load(self, sensor: Sensor, cover: CoverName, seed: int) -> Load:
        """Return what acts on the array.

        Parameters
        ----------
        sensor : Sensor
            Sensor file.
        cover : str
            gauss, layer or half_space.
        seed : int
            Seed of the random part of forces.
        """
        spread = cover_of(sensor, cover)
        step = 1.0 / sensor.can.scan_rate
        time: Array = step * np.arange(round(self.duration / step) + 1, dtype=np.float64)
        rng = np.random.default_rng([seed, 3])
        force, applied = np.zeros((len(time), sensor.layout.taxels)), np.zeros(len(time))
        for touch in self.touches:
            pressed = _pressed(touch, time, rng)
            begin, end = _span(pressed)
            applied += pressed
            force[begin:end] += pressed[begin:end, None] * _shares(spread, touch, time[begin:end], pressed[begin:end])
        times, rises = (np.array(each) for each in zip(*self.chip, strict=True))
        warming = np.interp(time, times, rises)
        return Load(force, applied, warming)


def _pressed(touch: Touch, time: Array, rng: np.random.Generator) -> Array:
    """Return the force of an object [N], shape [scans]."""
    force = course(touch.force, time)
    size, frequency = touch.tremor
    if size:
        # The frequency of a tremor is no line: its phase walks, by 1 rad within 1 s.
        step = time[1] - time[0]
        walk = np.cumsum(rng.standard_normal(len(time))) * math.sqrt(step)
        force = force * (1.0 + size * np.sin(2.0 * math.pi * frequency * time + walk))
    if touch.wander:
        coarse = np.arange(0.0, time[-1] + 1.0, 0.25)
        values = rng.standard_normal(len(coarse))
        decay = math.exp(-0.25 / 5.0)
        for index in range(1, len(values)):
            values[index] = decay * values[index - 1] + math.sqrt(1.0 - decay**2) * values[index]
        force = force * (1.0 + touch.wander * np.interp(time, coarse, values))
    return force


def _span(force: Array) -> tuple[int, int]:
    """Return the scans (first, last + 1) in which there is a force."""
    pressed = np.flatnonzero(force)
    return (int(pressed[0]), int(pressed[-1]) + 1) if len(pressed) else (0, 0)


def _shares(cover: Cover, touch: Touch, time: Array, force: Array) -> Array:
    """Return the shares of the taxels [1], shape [scans, taxels]; computed at every few scans."""
    if not len(time):
        return np.zeros((0, len(cover.positions)))
    moves = len(touch.x) > 1 or len(touch.y) > 1
    if not moves and len(touch.shape.forces) == 1:
        x, y = (course(knots, time[:1]) for knots in (touch.x, touch.y))
        return np.broadcast_to(cover.shares(touch.shape, x, y, force[:1]), (len(time), len(cover.positions)))
    places = np.unique(np.append(np.arange(0, len(time), PATH_STEP), len(time) - 1))
    x, y = (course(knots, time[places]) for knots in (touch.x, touch.y))
    coarse = cover.shares(touch.shape, x, y, force[places])
    index = np.minimum(np.arange(len(time)) // PATH_STEP, max(len(places) - 2, 0))
    following = np.minimum(index + 1, len(places) - 1)
    gap = np.maximum(places[following] - places[index], 1)
    part = ((np.arange(len(time)) - places[index]) / gap)[:, None]
    shares: Array = (1.0 - part) * coarse[index] + part * coarse[following]
    return shares


def _bilinear(maps: Array, level: NDArray[np.intp], row: Array, column: Array) -> Array:
    """Return values of maps between their points; 0 beyond their edges."""
    level = np.broadcast_to(level[:, None], row.shape)
    inside = (row >= 0.0) & (row < GRID - 1) & (column >= 0.0) & (column < GRID - 1)
    row, column = np.where(inside, row, 0.0), np.where(inside, column, 0.0)
    i, j = row.astype(np.intp), column.astype(np.intp)
    u, v = row - i, column - j
    near = (1.0 - v) * maps[level, i, j] + v * maps[level, i, j + 1]
    far = (1.0 - v) * maps[level, i + 1, j] + v * maps[level, i + 1, j + 1]
    return np.where(inside, (1.0 - u) * near + u * far, 0.0)


def _hertz_radius(force: float, radius: float, modulus: float) -> float:
    """Return the radius of the contact of a ball [m]."""
    return float((0.75 * force * radius / modulus) ** (1.0 / 3.0))


def _press(begin: float, end: float, force: float, rise: float = 0.1, fall: float = 0.1) -> list[tuple[float, float]]:
    """Return the knots of one press."""
    return [(begin, 0.0), (begin + rise, force), (end - fall, force), (end, 0.0)]


def _in_a_row(*parts: Knots) -> Knots:
    """Return the knots of parts that follow one another."""
    return [knot for part in parts for knot in part]


def scenes() -> dict[str, Scene]:
    """Return all scenes by their names. Every one begins with two seconds at rest."""
    mm, finger, tip = 1e-3, sphere(6e-3, 1e6), sphere(2e-3)
    made = [
        Scene(
            "mixed",
            43.5,
            (
                Touch(tip, _press(2.0, 3.0, 0.3), ((0.0, -1.7 * mm),), ((0.0, 1.2 * mm),)),
                Touch(finger, _press(4.0, 5.2, 0.7, 0.15), ((0.0, 0.4 * mm),), ((0.0, -0.7 * mm),)),
                Touch(finger, _press(6.2, 7.4, 1.2, 0.05), ((0.0, 1.6 * mm),), ((0.0, 0.3 * mm),)),
                Touch(finger, _press(8.4, 9.9, 2.0, 0.2), ((0.0, -0.9 * mm),), ((0.0, -1.4 * mm),)),
                Touch(
                    finger,
                    _press(11.0, 15.0, 1.0),
                    ((11.5, -2.0 * mm), (14.5, 2.0 * mm)),
                    ((11.5, -0.5 * mm), (14.5, 0.8 * mm)),
                ),
                Touch(finger, _press(16.5, 37.0, 2.0), ((0.0, 0.6 * mm),), ((0.0, 0.9 * mm),)),
            ),
        ),
        Scene(
            "pad",
            31.0,
            tuple(
                Touch(shape, _press(begin, begin + 5.0, 2.0, rise), ((0.0, x),), ((0.0, y),))
                for shape, begin, rise, x, y in (
                    (rectangle(4 * mm, 4 * mm), 2.0, 0.1, 0.9 * mm, 0.8 * mm),
                    (rectangle(4 * mm, 4 * mm), 8.0, 0.3, -0.6 * mm, 0.4 * mm),
                    (rectangle(6.8 * mm, 6.8 * mm), 14.0, 0.1, 0.0, 0.0),
                    (rigid_punch(6.0 * mm, 6.5 * mm), 20.0, 0.3, 0.2 * mm, -0.1 * mm),
                )
            ),
        ),
        Scene(
            "pad_slow",
            26.0,
            tuple(
                Touch(shape, _press(begin, begin + held, 2.0, 1.0), ((0.0, x),), ((0.0, y),))
                for shape, begin, held, x, y in (
                    (rectangle(4 * mm, 4 * mm), 2.0, 6.0, 0.9 * mm, 0.8 * mm),
                    (rectangle(6.8 * mm, 6.8 * mm), 9.0, 6.0, 0.0, 0.0),
                    (rigid_punch(6.0 * mm, 6.5 * mm), 15.5, 5.0, 0.2 * mm, 0.0),
                )
            ),
        ),
        Scene(
            "pad_slower",
            45.0,
            tuple(
                Touch(shape, _press(begin, begin + 9.0, 2.0, 4.0), ((0.0, x),), ((0.0, 0.0),))
                for shape, begin, x in (
                    (rectangle(6.8 * mm, 6.8 * mm), 2.0, 0.0),
                    (rigid_punch(6.0 * mm, 6.5 * mm), 15.0, 0.2 * mm),
                    (rectangle(6.8 * mm, 6.8 * mm), 27.0, 0.0),
                )
            ),
        ),
        Scene(
            "slow",
            22.0,
            (
                Touch(
                    finger, [(2.0, 0.0), (12.0, 0.2), (16.0, 0.2), (16.2, 0.0)], ((0.0, 0.5 * mm),), ((0.0, -0.4 * mm),)
                ),
            ),
        ),
        Scene(
            "sliding",
            20.0,
            (
                Touch(
                    finger,
                    [(2.0, 0.0), (2.2, 1.0), (5.0, 1.0), (6.0, 1.6), (9.0, 0.8), (14.3, 1.2), (14.5, 0.0)],
                    (
                        (3.0, -2.2 * mm),
                        (5.0, 2.2 * mm),
                        (5.5, 2.2 * mm),
                        (6.5, -2.0 * mm),
                        (10.0, 1.0 * mm),
                        (13.0, 0.0),
                    ),
                    ((3.0, 0.0), (5.0, 1.0 * mm), (7.0, -1.8 * mm), (10.0, 1.8 * mm), (13.0, 0.0)),
                ),
            ),
        ),
        Scene(
            "ridged",
            20.0,
            (
                Touch(
                    ridges(3, 2.0 * mm, 0.8 * mm, 6.0 * mm),
                    [(2.0, 0.0), (2.2, 1.5), (6.0, 1.5), (7.0, 2.0), (14.3, 2.0), (14.5, 0.0)],
                    ((6.0, -0.5 * mm), (9.0, 1.2 * mm), (12.0, -0.8 * mm)),
                ),
            ),
        ),
        Scene(
            "rolling",
            20.0,
            (
                Touch(
                    sphere(12e-3, 1e6),
                    [(2.0, 0.0), (2.4, 0.8), (5.0, 1.5), (8.0, 1.0), (11.0, 1.5), (14.0, 0.8), (14.4, 0.0)],
                    ((2.5, -2.5 * mm), (7.0, 2.5 * mm), (9.0, 2.5 * mm), (13.5, -2.5 * mm)),
                    ((2.5, 0.5 * mm), (13.5, -0.5 * mm)),
                ),
            ),
        ),
        Scene(
            "ring",
            17.0,
            (
                Touch(ring(2.5 * mm, 1.8 * mm), _press(2.0, 6.0, 1.5, 0.2), ((0.0, 0.2 * mm),), ((0.0, -0.3 * mm),)),
                Touch(ring(1.6 * mm, 0.9 * mm), _press(7.5, 11.5, 1.0, 0.2), ((0.0, -1.2 * mm),), ((0.0, 0.9 * mm),)),
            ),
        ),
        Scene(
            "hold300",
            309.0,
            (Touch(finger, _press(2.0, 302.0, 2.0, 0.2), ((0.0, 0.3 * mm),), ((0.0, -0.5 * mm),), (0.005, 1.3), 0.01),),
        ),
        Scene(
            "overload",
            20.0,
            (
                Touch(finger, _press(2.0, 4.0, 20.0, 0.2), ((0.0, 0.4 * mm),), ((0.0, 0.4 * mm),)),
                Touch(finger, _press(9.0, 14.0, 0.1), ((0.0, 0.4 * mm),), ((0.0, 0.4 * mm),)),
            ),
        ),
        Scene(
            "tap",
            12.0,
            tuple(
                Touch(
                    tip, [(at, 0.0), (at + 0.5 * width, force), (at + width, 0.0)], ((0.0, x * mm),), ((0.0, y * mm),)
                )
                for at, width, force, x, y in (
                    (2.0002, 1e-3, 0.5, 0.2, 0.1),
                    (3.0, 2e-3, 0.5, -1.5, 0.8),
                    (4.0, 3e-3, 1.0, 1.0, -1.2),
                    (5.0, 3e-3, 0.3, 0.0, 1.4),
                    (6.0, 2e-3, 1.5, -0.6, -0.6),
                )
            ),
            sharp=True,
        ),
        Scene(
            "grasp",  # a finger of a hand that holds a cup: tremor, and a grip that yields slowly
            36.0,
            (
                Touch(
                    finger,
                    [(2.0, 0.0), (2.3, 1.2), (12.0, 1.0), (22.0, 1.5), (30.0, 1.3), (30.2, 0.0)],
                    ((0.0, -0.4 * mm), (30.0, 0.3 * mm)),
                    ((0.0, 0.5 * mm),),
                    (0.02, 7.0),
                    0.02,
                ),
            ),
        ),
        Scene(
            "regrasp",  # lets go and closes again on the same place, each time with another force
            38.0,
            tuple(
                Touch(finger, _press(begin, begin + held, force, rise), ((0.0, 0.5 * mm),), ((0.0, 0.3 * mm),))
                for begin, held, force, rise in (
                    (2.0, 2.0, 0.5, 0.1),
                    (4.6, 3.0, 1.8, 0.2),
                    (8.1, 2.0, 0.3, 0.1),
                    (10.6, 3.5, 1.2, 0.3),
                    (14.5, 2.5, 2.0, 0.1),
                    (17.3, 3.0, 0.6, 0.2),
                    (21.0, 3.5, 1.5, 0.1),
                    (25.0, 2.0, 0.4, 0.1),
                    (27.5, 4.0, 1.0, 0.5),
                )
            ),
        ),
        Scene(
            "handle",  # the edge of a handle, a strip that tilts and moves over the whole array
            27.0,
            (
                Touch(
                    rectangle(14.0 * mm, 1.2 * mm, 0.35),
                    [(2.0, 0.0), (2.2, 2.5), (8.0, 2.5), (9.0, 4.0), (20.0, 2.0), (20.3, 0.0)],
                    ((0.0, 0.0),),
                    ((4.0, -2.4 * mm), (9.0, 1.5 * mm), (13.0, -1.0 * mm), (18.0, 2.0 * mm)),
                    (0.01, 9.0),
                ),
            ),
        ),
        Scene(
            "power_on",  # held while the chip warms up after its supply was switched on: 5 K, 60 s
            95.0,
            (
                Touch(finger, _press(3.0, 33.0, 1.5, 0.2), ((0.0, 0.4 * mm),), ((0.0, 0.6 * mm),), (0.01, 6.0), 0.01),
                Touch(finger, _press(36.0, 60.0, 0.8, 0.2), ((0.0, -0.8 * mm),), ((0.0, -0.6 * mm),)),
                Touch(rectangle(4 * mm, 4 * mm), _press(64.0, 88.0, 2.0, 0.3), ((0.0, 0.5 * mm),)),
            ),
            chip=[(at, 5.0 * -math.expm1(-at / 60.0)) for at in np.linspace(0.0, 95.0, 191).tolist()],
        ),
        Scene(
            "held_at_start",  # by a finger that has warmed the chip for long
            47.0,
            (
                Touch(finger, _press(2.0, 24.0, 1.0, 0.2), ((0.0, 0.4 * mm),), ((0.0, 0.3 * mm),)),
                Touch(finger, _press(27.0, 31.0, 1.0, 0.2), ((0.0, 0.4 * mm),), ((0.0, 0.3 * mm),)),
                Touch(finger, _press(33.0, 41.0, 2.0, 0.2), ((0.0, -0.8 * mm),), ((0.0, -0.6 * mm),)),
            ),
            starts=20.0,
        ),
        Scene(
            "two_fingers",  # unequal, and one is lifted first
            26.0,
            (
                Touch(finger, _press(2.0, 17.0, 1.5, 0.2), ((0.0, -1.8 * mm),), ((0.0, -1.0 * mm),), (0.01, 8.0)),
                Touch(sphere(4e-3, 1e6), _press(3.0, 11.0, 0.5, 0.2), ((0.0, 1.9 * mm),), ((0.0, 1.3 * mm),)),
                Touch(sphere(4e-3, 1e6), _press(13.0, 20.0, 0.6, 0.2), ((0.0, 1.9 * mm),), ((0.0, 1.3 * mm),)),
            ),
        ),
    ]
    return {scene.name: scene for scene in made}
