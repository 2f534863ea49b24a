"""Design of a taxel: what film and poling do to sensitivity, noise, leakage, and to the I-V curves below them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from posfet_model._lib.types import Array
from posfet_model.amplifier.two_stage import figures_of_merit
from posfet_model.device import paper
from posfet_model.device.adc import lsb
from posfet_model.device.noise import NoiseBudget, gate_flicker_coefficient, noise_budget, pair_density
from posfet_model.device.taxel import Taxel
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

BAND: Final = (0.1, 1000.0)
"""Band of the noise [Hz]."""

ADC: Final = (16, -5.0, 5.0)
"""Bits and range [V] of the ADC, assumed."""

SIGMAS: Final = 3.0
"""Smallest force in standard deviations of the noise."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the film and how it is drawn."""

    name: str
    """Quantity with its unit, the label of the axis."""
    values: Array
    """Values along the axis, in its unit."""
    default: float
    """Value of the paper, in the unit of the axis."""
    shown: tuple[float, ...]
    """Values of the I-V curves, in the unit of the axis."""
    taxel: Callable[[Any], Taxel]
    """Taxel of a value in the unit of the axis."""


PARAMETERS: Final = (
    Parameter(
        "film thickness [µm]",
        np.logspace(-0.3, 1.3, 41),
        paper.FILM_THICKNESS.value * 1e6,
        (1.0, 2.5, 10.0),
        lambda microns: Taxel(film_thickness=microns * 1e-6),
    ),
    Parameter(
        "film area [mm²]",
        np.logspace(-1, 1, 41),
        paper.FORCE_AREA.value * 1e6,
        (0.25, 1.0, 4.0),
        lambda square_millimetres: Taxel(film_area=square_millimetres * 1e-6),
    ),
    Parameter(
        "permittivity [1]",
        np.logspace(np.log10(5), np.log10(50), 41),
        paper.FILM_PERMITTIVITY.value,
        (7.5, 12.0, 40.0),
        lambda permittivity: Taxel(film_permittivity=permittivity),
    ),
    Parameter(
        "poling voltage [V]",
        np.linspace(10, 250, 41),
        160.0,
        (0.0, 80.0, 160.0),
        lambda volts: Taxel(poling_voltages=(volts,)),
    ),
)


def noise(taxel: Taxel) -> NoiseBudget:
    """Return the noise of taxels in `BAND` at the gate, behind the two-stage follower and an ADC of 16 bit.

    Parameters
    ----------
    taxel : Taxel
        One taxel or an array of them.

    Returns
    -------
    NoiseBudget
        Noise by source [V rms].
    """
    op_amp = figures_of_merit()
    at_oxide = gate_flicker_coefficient(
        paper.FLICKER_CONSTANT.value, taxel.gate_width, taxel.gate_length, taxel.oxide_capacitance
    )
    thermal = pair_density(op_amp.input_transconductance, op_amp.load_transconductance, paper.TEMPERATURE.value)
    return noise_budget(
        taxel.bias_noise(*BAND),
        thermal,
        2 * at_oxide / taxel.coupling**2,  # of both transistors of the pair
        lsb(*ADC),
        np.abs(taxel.volts_per_newton()),
        *BAND,
    )


def film_design() -> Figure:
    """Draw sensitivity, noise, smallest force and leakage time constant against the film and its poling."""
    figure, panels = new_figure(7.4, rows=4, columns=len(PARAMETERS))
    for column, parameter in enumerate(PARAMETERS):
        sensitivity, volts, force, time = panels[column :: len(PARAMETERS)]
        x, taxel, one = parameter.values, parameter.taxel(parameter.values), parameter.taxel(parameter.default)
        budget, at_default = noise(taxel), noise(one)
        sensitivity.plot(x, taxel.volts_per_newton(), color=BLUE, linestyle=SOLID)
        sensitivity.plot(parameter.default, one.volts_per_newton(), "o", color=BLACK, markersize=4)
        for name, value, colour, dashes in (
            ("total", budget.total, BLUE, SOLID),
            ("bias resistor", budget.bias, VERMILION, DASHED),
            ("quantisation", budget.quantisation, GREEN, DOTTED),
            ("1/f", budget.flicker, PURPLE, DASH_DOT),
        ):
            volts.plot(x, 1e6 * np.broadcast_to(value, x.shape), color=colour, linestyle=dashes, label=name)
        volts.plot(parameter.default, 1e6 * at_default.total, "o", color=BLACK, markersize=4)
        force.plot(x, 1e3 * budget.minimum_force(SIGMAS), color=BLUE, linestyle=SOLID)
        force.plot(parameter.default, 1e3 * at_default.minimum_force(SIGMAS), "o", color=BLACK, markersize=4)
        time.plot(x, np.broadcast_to(taxel.leak_time_constant, x.shape), color=BLUE, linestyle=SOLID)
        time.plot(parameter.default, one.leak_time_constant, "o", color=BLACK, markersize=4)
        time.set_xlabel(parameter.name)
        for axes, limits in zip(
            (sensitivity, volts, force, time), ((0.03, 12), (0.1, 200), (0.005, 5), (0.2, 6)), strict=True
        ):
            axes.set(yscale="log", ylim=limits, xlim=(x[0], x[-1]))
            if "voltage" not in parameter.name:
                axes.set_xscale("log")
            ticks = _TICKS[parameter.name]
            axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.minorticks_off()
            if axes is time:
                axes.set_yticks([0.3, 1, 3], ["0.3", "1", "3"])
            if column:
                axes.tick_params(labelleft=False)
    names = ("sensitivity [V/N]", "noise [µV rms]", "smallest force [mN]", "time constant [s]")
    for axes, name in zip(panels[:: len(PARAMETERS)], names, strict=True):
        axes.set_ylabel(name)
    handles = panels[len(PARAMETERS)].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, frameon=False, fontsize=8, title="noise, second row",
                  title_fontsize=8)  # fmt: skip
    return figure


_TICKS: Final = {
    "film thickness [µm]": (1, 3, 10),
    "film area [mm²]": (0.1, 1, 10),
    "permittivity [1]": (5, 10, 20, 50),
    "poling voltage [V]": (50, 150, 250),
}


def iv_design() -> Figure:
    """Draw the transfer curves below films of several thicknesses, areas, permittivities and poling voltages."""
    figure, panels = new_figure(5.6, 2, 2)
    gate = np.linspace(0, 3, 151)
    for axes, parameter in zip(panels, PARAMETERS, strict=True):
        quantity, unit = parameter.name.rstrip("]").split(" [")
        for value, (colour, dashes) in zip(
            parameter.shown, ((VERMILION, DASHED), (BLUE, SOLID), (GREEN, DASH_DOT)), strict=True
        ):
            current = 1e3 * parameter.taxel(value).drain_current(gate, 5.0)
            text = f"{value:g}" if unit == "1" else f"{value:g} {unit}" + ("" if value else ", virgin film")
            axes.plot(gate, current, color=colour, linestyle=dashes, label=text)
        axes.legend(loc="upper left", frameon=False, fontsize=8, handlelength=3.2)
        axes.set(title=quantity, xlim=(0, 3), ylim=(0, 45))
    for axes in panels[2:]:
        axes.set_xlabel("gate voltage $V_{gs}$ [V]")
    for axes in panels[::2]:
        axes.set_ylabel("$I_d$ at $V_{ds}$ = 5 V [mA]")
    return figure


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"design_film": film_design, "design_iv": iv_design}
