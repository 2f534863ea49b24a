# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Effect of the misprints: corrected curves compared with the printed ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posfet_model.device import as_printed, paper
from posfet_model.device.mechanics import circular_deflection, square_deflection
from posfet_model.device.transistor import Plane, drain_current, threshold_shift
from posfet_model.figures.style import BLACK, BLUE, DASHED, GREY, SOLID, VERMILION, label, new_figure

_STACK = paper.STACK
_BETA = paper.channel_gain_factor(Plane.GATE)
_CORRECTED: Final[dict[str, Any]] = {"color": BLUE, "linestyle": SOLID}
_PRINTED: Final[dict[str, Any]] = {"color": VERMILION, "linestyle": DASHED}


def errata() -> Figure:
    """Draw eq. (10), (6-10), (6-7), (12) and (13), corrected (solid) and as printed (dashed)."""
    figure, panels = new_figure(8.0, 3, 2)
    for panel, draw in zip(panels, (_saturation, _planes, _shift, _sign, _deflection, _dimension), strict=True):
        draw(panel)
    return figure


def _saturation(axes: Axes) -> None:
    drain = np.linspace(0, 3, 301)
    overdrive = 1.0
    current = drain_current(0.7 + overdrive, drain, 0.7, _BETA) * 1e3
    printed = np.where(drain < overdrive, current, as_printed.saturation_current(0.7 + overdrive, 0.7, _BETA) * 1e3)
    axes.plot(drain, printed, **_PRINTED)
    axes.plot(drain, current, **_CORRECTED)
    label(axes, 2.95, 0.98, "as printed", VERMILION, ha="right", bbox=None)
    label(axes, 2.95, 0.51, "corrected", BLUE, ha="right", bbox=None)
    axes.set(
        xlabel="drain voltage $V_{ds}$ [V]",
        ylabel="drain current $I_d$ [mA]",
        xlim=(0, 3),
        ylim=(0, 1.1),
        title="Eq. (10): factor 1/2",
    )


def _planes(axes: Axes) -> None:
    force = np.linspace(0, 5, 11)
    charge = -paper.PIEZOELECTRIC_COEFFICIENT.value * force / paper.FORCE_AREA.value
    aspect = paper.CHANNEL_WIDTH.value / paper.CHANNEL_LENGTH.value
    corrected = -_BETA * threshold_shift(charge, _STACK, Plane.GATE, 1.0) * 1e3
    printed = as_printed.signal_current(charge, 1.0, paper.MOBILITY.value, aspect, _STACK) * 1e3
    axes.plot(force, corrected, marker="o", markersize=3.5, **_CORRECTED)
    axes.plot(force, printed, marker="s", markersize=3.5, **_PRINTED)
    label(axes, 2.6, 2.75, "corrected", BLUE, ha="right", bbox=None)
    label(
        axes, 4.95, 0.45, f"as printed, {corrected[-1] / printed[-1]:.1f} times less", VERMILION, ha="right", bbox=None
    )
    axes.set(xlabel="force on 1 mm² [N]", ylabel="signal current [mA]", xlim=(0, 5), ylim=(0, 4.5))
    axes.set_title("Eq. (6)-(10): one plane")


def _shift(axes: Axes) -> None:
    kappa = np.logspace(-3, 0, 201)
    charge = paper.FILM.switched_polarisation
    axes.plot(kappa, -threshold_shift(charge, _STACK, Plane.OXIDE, kappa), **_CORRECTED)
    axes.plot(1.0, -as_printed.threshold_shift(charge, _STACK), marker="s", color=VERMILION, clip_on=False, zorder=6)
    breakdown = 1e9 * paper.OXIDE_THICKNESS.value
    axes.axhline(breakdown, color=GREY, linewidth=1.0)
    label(
        axes, 1.15e-3, breakdown * 1.12, "oxide breaks down,\n10 MV/cm", BLACK, va="bottom", bbox=None, linespacing=1.1
    )
    label(axes, 0.7, 115, "as printed", VERMILION, ha="right", bbox=None)
    axes.plot(0.010962, 1.0, marker="o", color=BLACK, markersize=5)
    label(axes, 0.0145, 0.72, "1 V at κ = 0.011", BLACK, bbox=None)
    axes.set(xlabel="uncompensated fraction κ [1]", ylabel="threshold shift −ΔV [V]", xscale="log", yscale="log")
    axes.set(xlim=(1e-3, 1), ylim=(0.08, 300), title="Eq. (6), (7): compensation")


def _sign(axes: Axes) -> None:
    charge = np.linspace(-0.07, 0.07, 29)
    shift = threshold_shift(charge, _STACK, Plane.OXIDE, 0.010962)
    axes.plot(100 * charge, shift, **_CORRECTED)
    axes.plot(100 * charge[charge <= 0], -shift[charge <= 0], **_PRINTED)
    axes.axhline(0, color=GREY, linewidth=0.8)
    label(axes, -2.6, 0.62, "corrected", BLUE, bbox=None)
    label(axes, -3.2, -0.85, "in the text", VERMILION, bbox=None)
    axes.set(xlabel="charge σ [µC/cm²]", ylabel="threshold shift ΔV [V]", xlim=(-7, 7), ylim=(-1.1, 1.1))
    axes.set_title("Eq. (6), (7): sign, at κ = 0.011")


def _dimension(axes: Axes) -> None:
    side = np.logspace(-0.7, 0.3, 61)
    silicon = (paper.SILICON_MODULUS.value, paper.SILICON_POISSON_RATIO.value)
    corrected = square_deflection(10.0, side * 1e-2, 50e-6, *silicon).deflection * 1e9
    at_one = float(square_deflection(10.0, 1e-2, 50e-6, *silicon).deflection) * 1e9
    axes.plot(side, corrected, **_CORRECTED)
    axes.plot(side, at_one * side, **_PRINTED)
    axes.plot(1.0, at_one, "o", color=BLACK, markersize=5, zorder=6)
    label(axes, 0.62, 3.0, "corrected, $a^4$", BLUE, bbox=None)
    label(axes, 0.22, 60, "in the text, $a$", VERMILION, bbox=None)
    axes.set(xlabel="side $a$ [cm]", ylabel="deflection at 10 Pa [nm]", xscale="log", yscale="log", xlim=(0.2, 2))
    axes.set_xticks([0.2, 0.5, 1, 2], ["0.2", "0.5", "1", "2"])
    axes.set_xticks([], minor=True)
    axes.set_title("Eq. (12), (13): fourth power")


def _deflection(axes: Axes) -> None:
    thickness = np.linspace(20e-6, 100e-6, 201)
    plate = (50.0, 5e-3, thickness, paper.SILICON_MODULUS.value, paper.SILICON_POISSON_RATIO.value)
    axes.plot(thickness * 1e6, circular_deflection(*plate).deflection * 1e6, **_CORRECTED)
    axes.plot(thickness * 1e6, as_printed.circular_deflection(*plate) * 1e6, **_PRINTED)
    label(axes, 33, 1.35, "corrected", BLUE, bbox=None)
    label(axes, 21.5, 0.03, "as printed,\nπ times less", VERMILION, bbox=None)
    axes.set(xlabel="thickness [µm]", ylabel="deflection at 50 Pa [µm]", yscale="log", xlim=(20, 100))
    axes.set_title("Eq. (12): extra factor π")


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"errata": errata}
