# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What film and poling do to a design: sensitivity, noise, leakage, bandwidth, and the I-V curves below them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from posfet_model._lib.types import Array
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.device import paper
from posfet_model.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GREEN,
    PURPLE,
    SOLID,
    VERMILION,
    new_figure,
)

SATURATING: Final = 400.0
"""Poling voltage that leaves the default film, saturated in the other panels, at 99.9 % of Pr [V]."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the film and how it is drawn."""

    name: str
    """Quantity with its unit, the label of the axis."""
    values: Array
    """Values along the axis, in its unit."""
    default: float
    """Value of the default design, in the unit of the axis."""
    shown: tuple[float, ...]
    """Values of the I-V curves, in the unit of the axis."""
    design: Callable[[Any], PosfetDesign]
    """Design of a value in the unit of the axis."""


PARAMETERS: Final = (
    Parameter(
        "film thickness [µm]",
        np.logspace(-0.3, 1.3, 41),
        paper.FILM_THICKNESS.value * 1e6,
        (1.0, 2.5, 10.0),
        lambda microns: PosfetDesign(film_thickness=microns * 1e-6),
    ),
    Parameter(
        "film area [mm²]",
        np.logspace(-1, 1, 41),
        paper.FORCE_AREA.value * 1e6,
        (0.25, 1.0, 4.0),
        lambda square_millimetres: PosfetDesign(film_area=square_millimetres * 1e-6),
    ),
    Parameter(
        "permittivity [1]",
        np.logspace(np.log10(5), np.log10(50), 41),
        paper.FILM_PERMITTIVITY.value,
        (7.5, 12.0, 40.0),
        lambda permittivity: PosfetDesign(film_permittivity=permittivity),
    ),
    Parameter(
        "poling voltage [V]",
        np.linspace(10, 440, 44),
        SATURATING,
        (0.0, 120.0, SATURATING),
        lambda volts: PosfetDesign(poling_voltages=(volts,)),
    ),
)


def film_design() -> Figure:
    """Draw sensitivity, noise, smallest force and leakage time constant against the film and its poling."""
    figure, panels = new_figure(8.4, rows=len(_ROWS), columns=len(PARAMETERS))
    for column, parameter in enumerate(PARAMETERS):
        x, designs, one = parameter.values, parameter.design(parameter.values), PosfetDesign()
        for axes, (name, (limits, ticks, values)) in zip(panels[column :: len(PARAMETERS)], _ROWS.items(), strict=True):
            if name.startswith("noise"):
                for source, (colour, dashes) in _SOURCES.items():
                    volts = 1e6 * np.broadcast_to(designs.noise.sources[source], x.shape)
                    axes.plot(x, volts, color=colour, linestyle=dashes, label=source)
            axes.plot(x, np.broadcast_to(values(designs), x.shape), color=BLUE, linestyle=SOLID, label="total")
            axes.plot(parameter.default, values(one), "o", color=BLACK, markersize=4)
            axes.set(yscale="log", ylim=limits, xlim=(x[0], x[-1]))
            if "voltage" not in parameter.name:
                axes.set_xscale("log")
            places = _TICKS[parameter.name]
            axes.set_xticks(places, [f"{tick:g}" for tick in places])
            axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.minorticks_off()
            axes.tick_params(labelleft=not column)
        axes.set_xlabel(parameter.name)
    for axes, name in zip(panels[:: len(PARAMETERS)], _ROWS, strict=True):
        axes.set_ylabel(name)
    handles = panels[len(PARAMETERS)].get_legend_handles_labels()
    figure.legend(
        *handles,
        loc="outside upper center",
        ncols=5,
        frameon=False,
        fontsize=8,
        title="noise, second row",
        title_fontsize=8,
    )
    return figure


_ROWS: Final[dict[str, tuple[tuple[float, float], tuple[float, ...], Callable[[PosfetDesign], Any]]]] = {
    "sensitivity [V/N]": ((0.03, 12), (0.1, 1, 10), lambda design: design.volts_per_newton()),
    "noise [µV rms]": ((0.5, 200), (1, 10, 100), lambda design: 1e6 * design.noise.total),
    "smallest force [mN]": ((0.02, 5), (0.1, 1), lambda design: 1e3 * design.smallest_force),
    "time constant [s]": ((0.2, 6), (0.3, 1, 3), lambda design: design.leak_time_constant),
    "unity crossing [MHz]": ((0.8, 20), (1, 3, 10), lambda design: design.amplifier.gain_bandwidth / 1e6),
}
"""Limits, ticks and value of each row, by its label."""

_SOURCES: Final = {
    "bias": (VERMILION, DASHED),
    "quantisation": (GREEN, DOTTED),
    "flicker": (PURPLE, DASH_DOT),
    "sampling": (BLACK, (0, (3, 1, 1, 1, 1, 1))),
}
"""Looks of the sources of noise; thermal noise is below the panel."""

_TICKS: Final = {
    "film thickness [µm]": (1, 3, 10),
    "film area [mm²]": (0.1, 1, 10),
    "permittivity [1]": (5, 10, 20, 50),
    "poling voltage [V]": (100, 200, 400),
}


_STATES: Final = {0.0: ", virgin film", SATURATING: ", saturated film"}
"""States of the film by its poling voltage [V]."""


def iv_design() -> Figure:
    """Draw the transfer curves below films of several thicknesses, areas, permittivities and poling voltages."""
    figure, panels = new_figure(5.6, 2, 2)
    gate = np.linspace(0, 3, 151)
    for axes, parameter in zip(panels, PARAMETERS, strict=True):
        quantity, unit = parameter.name.rstrip("]").split(" [")
        others = iter(((VERMILION, DASHED), (GREEN, DASH_DOT)))
        for value in parameter.shown:
            colour, dashes = (BLUE, SOLID) if value == parameter.default else next(others)
            current = 1e3 * parameter.design(value).drain_current(gate, 5.0)
            state = _STATES.get(value, "") if "poling" in quantity else ""
            text = f"{value:g}" if unit == "1" else f"{value:g} {unit}{state}"
            axes.plot(gate, current, color=colour, linestyle=dashes, label=text)
        axes.legend(loc="upper left", frameon=False, fontsize=8)
        axes.set(title=f"{quantity}, $V_{{ds}}$ = 5 V", xlim=(0, 3), ylim=(0, 45))
    for axes in panels[2:]:
        axes.set_xlabel("gate voltage $V_{gs}$ [V]")
    for axes in panels[::2]:
        axes.set_ylabel("drain current $I_d$ [mA]")
    return figure


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"design_film": film_design, "design_iv": iv_design}
