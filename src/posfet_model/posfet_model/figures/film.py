# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Hysteresis of the film (the paper's Fig. 2) and the remnant polarisation after poling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posfet_model.device import paper
from posfet_model.device.film import VIRGIN, History, falling_branch, polarise, remnant_after, rising_branch
from posfet_model.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    SOLID,
    VERMILION,
    label,
    new_figure,
    second_axis,
)

_KV_PER_CM = 1e5
_UC_PER_CM2 = 1e-2
_FILM = paper.FILM


def hysteresis() -> Figure:
    """Draw polarisation against field: saturated loop, minor loops, virgin curve."""
    figure, (axes,) = new_figure(4.3)
    fields = np.linspace(-600, 600, 601) * _KV_PER_CM
    for branch, name in ((rising_branch, "saturated loop"), (falling_branch, None)):
        polarisation = branch(fields, _FILM) / _UC_PER_CM2
        axes.plot(fields / _KV_PER_CM, polarisation, color=BLACK, linestyle=SOLID, label=name)
    for volts, colour, dashes in ((80, BLUE, DASHED), (40, VERMILION, DASH_DOT)):
        limit = volts / paper.FILM_THICKNESS.value
        up, down = np.linspace(-limit, limit, 201), np.linspace(limit, -limit, 201)
        start = polarise([limit, -limit], _FILM).history
        axes.plot(*_curve(np.concatenate([up, down]), start), color=colour, linestyle=dashes, label=f"±{volts} V")
    axes.plot(
        *_curve(np.linspace(0, 600, 301) * _KV_PER_CM, VIRGIN), color=GREEN, linestyle=DOTTED, label="virgin curve"
    )
    axes.plot([0, 0], [2, -2], linestyle="none", marker="o", markersize=5, color=BLACK, zorder=6)
    coercive = _FILM.coercive_field / _KV_PER_CM
    for sign, place in ((1, "left"), (-1, "right")):
        branch = rising_branch if sign > 0 else falling_branch
        at = float(branch(sign * _FILM.coercive_field, _FILM)) / _UC_PER_CM2
        axes.plot(sign * coercive, at, marker="s", markersize=4.5, color=BLACK, zorder=6)
        label(
            axes,
            sign * (coercive + 15),
            at - 0.45 * sign,
            f"{'−' if sign < 0 else ''}$E_c$",
            BLACK,
            ha=place,
            va="center",
        )
    axes.legend(loc="lower right", frameon=False, fontsize=8.5)
    label(axes, -15, 2.2, "$P_r$", BLACK, ha="right")
    label(axes, 15, -2.5, "$-P_r$", BLACK)
    axes.set(
        xlabel="electric field $E$ [kV/cm]",
        ylabel="polarisation $P$ [µC/cm²]",
        xlim=(-600, 600),
        ylim=(-6.2, 6.2),
    )
    second_axis(axes, "top", _KV_PER_CM * paper.FILM_THICKNESS.value, "voltage across 2.5 µm [V]")
    return figure


def poling() -> Figure:
    """Draw remnant polarisation and d33 against the poling voltage, for a new and for a saturated film."""
    figure, (axes,) = new_figure(3.4)
    volts = np.linspace(0, 160, 161)
    once = np.array([remnant_after([volt / paper.FILM_THICKNESS.value], _FILM) for volt in volts])
    saturated = polarise([1e10, 0.0], _FILM).history
    back = np.array([remnant_after([-volt / paper.FILM_THICKNESS.value], _FILM, saturated) for volt in volts])
    axes.plot(volts, once / _UC_PER_CM2, color=BLUE, linestyle=SOLID)
    axes.plot(volts, back / _UC_PER_CM2, color=VERMILION, linestyle=DASHED)
    axes.axhline(0, color=GREY, linewidth=0.8)
    label(axes, 96, 1.42, "new film, pulse of $+V$", BLUE, ha="right")
    label(axes, 87, -0.72, "saturated film, pulse of $-V$", VERMILION, ha="right")
    axes.set(
        xlabel="pulse voltage across 2.5 µm [V]",
        ylabel="remnant polarisation [µC/cm²]",
        xlim=(0, 160),
        ylim=(-2.2, 2.2),
    )
    scale = paper.PIEZOELECTRIC_COEFFICIENT.value * 1e12 / (_FILM.remnant_polarisation / _UC_PER_CM2)
    second_axis(axes, "right", scale, "$d_{33}$ [pC/N]")
    return figure


def _curve(fields: NDArray[np.float64], history: History) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return field and polarisation in the paper's units."""
    return fields / _KV_PER_CM, polarise(fields, _FILM, history).polarisation / _UC_PER_CM2


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"fig2_hysteresis": hysteresis, "poling": poling}
