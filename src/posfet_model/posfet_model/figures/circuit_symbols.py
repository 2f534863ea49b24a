# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Circuit symbols, drawn with lines; one unit is about a quarter of an inch."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from posfet_model.figures.style import BLACK, VERMILION

Point = tuple[float, float]


@dataclass(frozen=True)
class Pins:
    """Ends of a transistor's leads."""

    gate: Point
    top: Point
    """Drain of an n-channel transistor, source of a p-channel one."""
    bottom: Point


def wire(axes: Axes, *points: Point) -> None:
    """Draw a wire through points.

    Parameters
    ----------
    axes : Axes
        Panel.
    *points : tuple of float
        Corners of the wire.
    """
    axes.plot(*zip(*points, strict=True), color=BLACK, linewidth=1.1, solid_joinstyle="miter", zorder=2)


def node(axes: Axes, x: float, y: float) -> None:
    """Draw the dot of a connection.

    Parameters
    ----------
    axes : Axes
        Panel.
    x, y : float
        Position.
    """
    axes.add_patch(Circle((x, y), 0.09, color=BLACK, zorder=3))


def transistor(
    axes: Axes, x: float, y: float, *, p_channel: bool = False, mirrored: bool = False, film: bool = False
) -> Pins:
    """Draw a MOS transistor, its arrow at the source, and return its pins.

    Parameters
    ----------
    axes : Axes
        Panel.
    x, y : float
        Position of drain and source leads and of the middle.
    p_channel, mirrored, film : bool, default False
        p-channel, its source on top; gate on the right; a film on the gate.
    """
    side = 1 if mirrored else -1
    channel, plate = x + side * 0.35, x + side * (0.75 if film else 0.55)
    wire(axes, (x, y + 1), (x, y + 0.4), (channel, y + 0.4))
    wire(axes, (x, y - 1), (x, y - 0.4), (channel, y - 0.4))
    axes.plot([channel, channel], [y - 0.55, y + 0.55], color=BLACK, linewidth=2.2, zorder=2)
    axes.plot([plate, plate], [y - 0.45, y + 0.45], color=BLACK, linewidth=1.6, zorder=2)
    if film:
        low = min(channel, plate) + 0.09
        axes.add_patch(Rectangle((low, y - 0.45), 0.22, 0.9, facecolor=VERMILION, edgecolor="none", zorder=2))
    wire(axes, (plate, y), (x + side * 1.1, y))
    arrow = y + 0.4 if p_channel else y - 0.4
    tip, tail = (channel, x) if p_channel else (x, channel)
    _arrow_head(axes, tip, arrow, 1 if tip > tail else -1)
    return Pins((x + side * 1.1, y), (x, y + 1), (x, y - 1))


def _arrow_head(axes: Axes, x: float, y: float, direction: int) -> None:
    back = x - direction * 0.28
    axes.add_patch(Polygon([(x, y), (back, y + 0.14), (back, y - 0.14)], color=BLACK, zorder=3))


def resistor(axes: Axes, start: Point, end: Point) -> None:
    """Draw a resistor between two points, horizontal or vertical.

    Parameters
    ----------
    axes : Axes
        Panel.
    start, end : tuple of float
        Ends of its leads.
    """
    (x0, y0), (x1, y1) = start, end
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    wide, high = (0.9, 0.36) if y0 == y1 else (0.36, 0.9)
    wire(axes, start, end)
    axes.add_patch(
        Rectangle((x - wide / 2, y - high / 2), wide, high, facecolor="white", edgecolor=BLACK, linewidth=1.1, zorder=3)
    )


def capacitor(axes: Axes, start: Point, end: Point) -> None:
    """Draw a capacitor between two points, horizontal or vertical.

    Parameters
    ----------
    axes : Axes
        Panel.
    start, end : tuple of float
        Ends of its leads.
    """
    (x0, y0), (x1, y1) = start, end
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    wire(axes, start, end)
    wide, high = (0.24, 0.8) if y0 == y1 else (0.8, 0.24)
    axes.add_patch(Rectangle((x - wide / 2, y - high / 2), wide, high, facecolor="white", edgecolor="none", zorder=3))
    for sign in (-1, 1):
        if y0 == y1:
            axes.plot([x + sign * wide / 2] * 2, [y - high / 2, y + high / 2], color=BLACK, linewidth=1.8, zorder=4)
        else:
            axes.plot([x - wide / 2, x + wide / 2], [y + sign * high / 2] * 2, color=BLACK, linewidth=1.8, zorder=4)


def current_source(axes: Axes, x: float, y: float) -> None:
    """Draw a current source, its current flowing down, with leads of one unit.

    Parameters
    ----------
    axes : Axes
        Panel.
    x, y : float
        Centre.
    """
    wire(axes, (x, y + 1), (x, y - 1))
    axes.add_patch(Circle((x, y), 0.45, facecolor="white", edgecolor=BLACK, linewidth=1.1, zorder=3))
    axes.plot([x, x], [y + 0.28, y - 0.05], color=BLACK, linewidth=1.1, zorder=4)
    axes.add_patch(Polygon([(x, y - 0.3), (x - 0.14, y - 0.02), (x + 0.14, y - 0.02)], color=BLACK, zorder=4))


def ground(axes: Axes, x: float, y: float) -> None:
    """Draw the symbol of 0 V below a point.

    Parameters
    ----------
    axes : Axes
        Panel.
    x, y : float
        The point.
    """
    for k, half in enumerate((0.4, 0.25, 0.1)):
        axes.plot([x - half, x + half], [y - 0.14 * k] * 2, color=BLACK, linewidth=1.4, zorder=2)
