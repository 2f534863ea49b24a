# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The schematic of the amplifier (the paper's Fig. 5), with the sizes of Table II and the bias of circuit B."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posfet_model.amplifier.operating_point import CIRCUIT_B
from posfet_model.device import paper
from posfet_model.figures.circuit_symbols import capacitor, current_source, ground, node, resistor, transistor, wire
from posfet_model.figures.style import BLACK, VERMILION, label, new_figure

_TOP, _BOTTOM = 10.0, 0.0
_LEFT, _FIRST, _SECOND, _OUT = 1.5, 6.4, 12.4, 19.7
_MILLER = 16.8


def schematic() -> Figure:
    """Draw Fig. 5: the two-stage amplifier as a voltage follower."""
    figure, (axes,) = new_figure(2.9)
    wire(axes, (_LEFT - 0.5, _TOP), (_OUT + 0.5, _TOP))
    wire(axes, (_LEFT - 0.5, _BOTTOM), (_OUT + 0.5, _BOTTOM))
    _bias(axes)
    _pair(axes)
    _output(axes)
    supply = CIRCUIT_B.supply
    label(axes, _LEFT - 0.7, _TOP, f"$V_{{DD}}$ = +{supply:g} V", BLACK, ha="right", va="center", bbox=None)
    label(axes, _LEFT - 0.7, _BOTTOM, f"$V_{{SS}}$ = −{supply:g} V", BLACK, ha="right", va="center", bbox=None)
    axes.set(xlim=(-2.9, 27.5), ylim=(-0.6, 10.6), aspect="equal")
    axes.set_axis_off()
    return figure


def size_label(name: str) -> str:
    """Return name, width and length [um] of a transistor of Table II.

    Parameters
    ----------
    name : str
        M1 to M8.
    """
    size = next(size for size in paper.AMPLIFIER_SIZES if size.name == name)
    return f"{name}\n{size.width * 1e6:.0f}/{size.length * 1e6:.0f}"


def _name(axes: Axes, name: str, x: float, y: float, ha: str = "left") -> None:
    label(axes, x + (0.25 if ha == "left" else -0.25), y, size_label(name), BLACK, ha=ha, va="center", bbox=None)


def _bias(axes: Axes) -> None:
    mirror = transistor(axes, _LEFT, 2.0, mirrored=True)
    wire(axes, mirror.bottom, (_LEFT, _BOTTOM))
    wire(axes, mirror.top, (_LEFT, 6.0))
    current_source(axes, _LEFT, 7.0)
    wire(axes, (_LEFT, 8.0), (_LEFT, _TOP))
    label(
        axes,
        _LEFT - 0.7,
        7.0,
        f"$I_{{ref}}$\n{CIRCUIT_B.reference_current * 1e6:.0f} µA",
        BLACK,
        ha="right",
        va="center",
        bbox=None,
    )
    wire(axes, (_LEFT, 3.6), (mirror.gate[0], 3.6), mirror.gate)
    for place in ((_LEFT, 3.6), mirror.gate, (_LEFT, _BOTTOM), (_LEFT, _TOP)):
        node(axes, *place)
    _name(axes, "M6", _LEFT, 2.0, "right")
    tail = (_FIRST + _SECOND) / 2
    sink = transistor(axes, tail, 2.0)
    wire(axes, mirror.gate, sink.gate)
    wire(axes, sink.bottom, (tail, _BOTTOM))
    node(axes, tail, _BOTTOM)
    _name(axes, "M5", tail, 2.0)
    output = transistor(axes, _OUT, 2.0)
    corner = sink.gate[0] - 0.6
    wire(axes, (corner, 2.0), (corner, 0.6), (output.gate[0], 0.6), output.gate)
    node(axes, corner, 2.0)
    wire(axes, output.bottom, (_OUT, _BOTTOM))
    node(axes, _OUT, _BOTTOM)
    _name(axes, "M8", _OUT, 2.0)


def _pair(axes: Axes) -> None:
    minus, plus = transistor(axes, _FIRST, 5.0, film=True), transistor(axes, _SECOND, 5.0, film=True, mirrored=True)
    tail = (_FIRST + _SECOND) / 2
    wire(axes, minus.bottom, (_FIRST, 3.6), (_SECOND, 3.6), plus.bottom)
    wire(axes, (tail, 3.6), (tail, 3.0))
    node(axes, tail, 3.6)
    left = transistor(axes, _FIRST, 8.4, p_channel=True, mirrored=True)
    right = transistor(axes, _SECOND, 8.4, p_channel=True)
    wire(axes, left.gate, right.gate)
    wire(axes, minus.top, left.bottom)
    wire(axes, plus.top, right.bottom)
    wire(axes, (_FIRST, 6.9), (left.gate[0], 6.9), left.gate)
    for place in ((_FIRST, 6.9), left.gate, (_FIRST, _TOP), (_SECOND, _TOP)):
        node(axes, *place)
    for pins in (left, right):
        wire(axes, pins.top, (pins.top[0], _TOP))
    _name(axes, "M3", _FIRST, 8.4, "right")
    _name(axes, "M4", _SECOND, 8.4)
    _name(axes, "M1", _FIRST, 5.0)
    _name(axes, "M2", _SECOND, 5.0, "right")
    label(axes, minus.gate[0] - 0.2, 5.0, "− (out)", BLACK, ha="right", va="center", bbox=None)
    label(axes, plus.gate[0] + 0.2, 5.0, "+ (taxel)", VERMILION, va="center", bbox=None)


def _output(axes: Axes) -> None:
    top = transistor(axes, _OUT, 8.4, p_channel=True)
    wire(axes, top.top, (_OUT, _TOP))
    node(axes, _OUT, _TOP)
    wire(axes, top.bottom, (_OUT, 3.0))
    wire(axes, (_SECOND, 6.9), (_MILLER, 6.9), (_MILLER, 8.4), top.gate)
    node(axes, _SECOND, 6.9)
    node(axes, _MILLER, 6.9)
    wire(axes, (_MILLER, 6.9), (_MILLER, 6.6))
    resistor(axes, (_MILLER, 6.6), (_MILLER, 5.0))
    wire(axes, (_MILLER, 5.0), (_MILLER, 4.0))
    capacitor(axes, (_MILLER, 4.0), (_OUT, 4.0))
    node(axes, _OUT, 4.0)
    label(
        axes,
        _MILLER - 0.35,
        5.8,
        f"$R_z$ {CIRCUIT_B.zero_resistor:.0f} Ω",
        BLACK,
        ha="right",
        va="center",
        bbox=None,
        fontsize=7.5,
    )
    label(
        axes,
        (_MILLER + _OUT) / 2,
        3.45,
        f"$C_c$ {CIRCUIT_B.compensation * 1e12:.1f} pF",
        BLACK,
        ha="center",
        va="top",
        bbox=None,
        fontsize=7.5,
    )
    _name(axes, "M7", _OUT, 8.4)
    out = _OUT + 6.6
    wire(axes, (_OUT, 5.0), (out, 5.0))
    node(axes, _OUT, 5.0)
    for x, draw, text in (
        (_OUT + 1.8, resistor, f"$R_L$\n{CIRCUIT_B.load_resistance / 1e3:.1f} kΩ"),
        (_OUT + 5.0, capacitor, f"$C_L$\n{CIRCUIT_B.load_capacitance * 1e12:.0f} pF"),
    ):
        node(axes, x, 5.0)
        draw(axes, (x, 5.0), (x, 3.0))
        ground(axes, x, 3.0)
        label(axes, x + 0.55, 4.0, text, BLACK, va="center", bbox=None, fontsize=7.5)
    label(axes, out + 0.15, 5.0, "out", BLACK, va="center", bbox=None)


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"fig5_schematic": schematic}
