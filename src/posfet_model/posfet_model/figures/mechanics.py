# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Deflection of the membrane against its thickness (eq. 12 and 13), and strain of a bent chip."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from posfet_model.device import paper
from posfet_model.device.mechanics import Layer, bend_on_cylinder, circular_deflection, square_deflection
from posfet_model.figures.style import BLACK, BLUE, DASH_DOT, DASHED, DOTTED, GREY, SOLID, VERMILION, label, new_figure

_SILICON = (paper.SILICON_MODULUS.value, paper.SILICON_POISSON_RATIO.value)
_MICRO = 1e-6


def deflection() -> Figure:
    """Draw the deflection of circular and square membranes of 1 cm; dotted beyond small-deflection theory."""
    figure, (axes,) = new_figure(4.2)
    thickness = np.logspace(np.log10(10e-6), np.log10(450e-6), 400)
    microns = thickness / _MICRO
    for pressure, name in ((1e2, "100 Pa"), (1e3, "1 kPa"), (1e4, "10 kPa"), (1e5, "100 kPa")):
        for bent, colour, dashes in (
            (square_deflection(pressure, 1e-2, thickness, *_SILICON), BLUE, SOLID),
            (circular_deflection(pressure, 5e-3, thickness, *_SILICON), VERMILION, DASHED),
        ):
            height = bent.deflection / _MICRO
            axes.plot(microns, np.where(bent.small, height, np.nan), color=colour, linestyle=dashes)
            axes.plot(microns, np.where(bent.small, np.nan, height), color=GREY, linestyle=DOTTED, linewidth=1.0)
        at = 235e-6
        low = float(circular_deflection(pressure, 5e-3, at, *_SILICON).deflection) / _MICRO
        label(axes, at / _MICRO, low * 0.66, name, BLACK, ha="right", va="top", bbox=None)
    axes.plot(microns, microns / 2, color=GREY, linewidth=1.2)
    label(axes, 11, 2.6, "$y = h/2$", BLACK, bbox=None)
    label(axes, 330, 480, "dotted: beyond\nsmall-deflection theory", BLACK, ha="right", va="center")
    axes.plot([], [], color=BLUE, linestyle=SOLID, label="square, $a$ = 1 cm, eq. (13)")
    axes.plot([], [], color=VERMILION, linestyle=DASHED, label="circular, $r$ = 0.5 cm, eq. (12)")
    axes.legend(loc="lower left", frameon=False, fontsize=8.5)
    axes.set(
        xlabel="membrane thickness $h$ [µm]",
        ylabel="deflection $y$ [µm]",
        xscale="log",
        yscale="log",
        xlim=(10, 450),
        ylim=(1e-4, 1e3),
    )
    axes.set_xticks([10, 20, 50, 100, 200, 450], ["10", "20", "50", "100", "200", "450"])
    axes.minorticks_off()
    return figure


def bending() -> Figure:
    """Draw the strain in the film of a chip on a cylinder against the cylinder's radius."""
    figure, (axes,) = new_figure(3.6)
    radius = np.logspace(-3, 0, 200)
    film = Layer(paper.FILM_THICKNESS.value, paper.FILM_MODULUS.value, paper.FILM_POISSON_RATIO.value)
    for thickness, colour, dashes, shift in (
        (450, BLACK, DASH_DOT, 1.35),
        (50, VERMILION, DASHED, 1.35),
        (20, BLUE, SOLID, 0.45),
    ):
        chip = [Layer(thickness * _MICRO, *_SILICON), film]
        strain = [100 * bend_on_cylinder(chip, value).film_strain for value in radius]
        axes.plot(radius * 1e3, strain, color=colour, linestyle=dashes)
        index = int(np.searchsorted(radius, 0.1 if shift > 1 else 0.05))
        side = {"ha": "left"} if shift > 1 else {"ha": "right"}
        label(axes, radius[index] * 1e3, strain[index] * shift, f"chip of {thickness} µm", colour, bbox=None, **side)
    axes.axhspan(0.5, 1.0, color="#e6e6e6", zorder=0)
    label(axes, 900, 0.71, "silicon fractures at 0.5 to 1 %", BLACK, ha="right", va="center", bbox=None)
    axes.set(
        xlabel="cylinder radius [mm]",
        ylabel="strain in the film [%]",
        xscale="log",
        yscale="log",
        xlim=(1, 1e3),
    )
    return figure


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"deflection": deflection, "bending": bending}
