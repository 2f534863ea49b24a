"""Output and transfer curves of the transistor, before and after poling (the paper's Fig. 3a and 3b)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from posfet_model.device import paper
from posfet_model.device.transistor import Plane, drain_current
from posfet_model.figures.style import BLACK, BLUE, DASHED, DOTTED, GREY, SOLID, VERMILION, label, new_figure

_BETA = paper.channel_gain_factor(Plane.GATE)
_BEFORE = paper.THRESHOLD_VOLTAGE.value
_AFTER = _BEFORE + paper.POLING_SHIFT.value
_MILLI = 1e-3


def output_curves() -> Figure:
    """Draw drain current against drain voltage for several gate voltages, before poling."""
    figure, (axes,) = new_figure(3.9)
    drain = np.linspace(0, 6, 301)
    for gate in (2.0, 3.0, 4.0, 5.0):
        current = drain_current(gate, drain, _BEFORE, _BETA) / _MILLI
        axes.plot(drain, current, color=BLUE, linestyle=SOLID)
        label(axes, 5.95, current[-1] + 0.28, f"$V_{{gs}}$ = {gate:.0f} V", BLUE, ha="right", bbox=None)
    overdrive = np.linspace(0, 4.45, 101)
    axes.plot(
        overdrive, drain_current(_BEFORE + overdrive, overdrive, _BEFORE, _BETA) / _MILLI, color=GREY, linestyle=DOTTED
    )
    label(axes, 4.45, 9.4, "$V_{ds} = V_{gs} - V_{th}$", GREY, ha="center")
    label(axes, 1.6, 9.4, "linear region", BLACK, ha="center", style="italic")
    label(axes, 5.5, 9.4, "saturation", BLACK, ha="center", style="italic")
    axes.set(xlabel="drain voltage  $V_{ds}$  [V]", ylabel="drain current  $I_d$  [mA]", xlim=(0, 6), ylim=(0, 10.2))
    return figure


def transfer_curves() -> Figure:
    """Draw drain current against gate voltage in saturation, before and after poling."""
    figure, (axes,) = new_figure(3.9)
    gate = np.linspace(-1, 4, 251)
    for threshold, colour, dashes in ((_BEFORE, BLUE, SOLID), (_AFTER, VERMILION, DASHED)):
        axes.plot(gate, drain_current(gate, 5.0, threshold, _BETA) / _MILLI, color=colour, linestyle=dashes)
        axes.plot(threshold, 0, marker="o", markersize=5, color=colour, clip_on=False, zorder=6)
    label(axes, 3.02, 1.9, "before poling", BLUE, ha="left")
    label(axes, 2.05, 3.35, "after poling", VERMILION, ha="right")
    level = 1.2
    crossing = [threshold + np.sqrt(2 * level * _MILLI / _BETA) for threshold in (_AFTER, _BEFORE)]
    axes.annotate("", (crossing[0], level), (crossing[1], level), arrowprops={"arrowstyle": "->", "color": BLACK})
    label(axes, crossing[0] - 0.08, level, "$\\Delta V$ = −1 V (assumed)", BLACK, ha="right", va="center")
    axes.set(xlabel="gate voltage  $V_{gs}$  [V]", ylabel="drain current  $I_d$  [mA]", xlim=(-1, 4), ylim=(0, 6))
    return figure


FIGURES: Final[dict[str, Callable[[], Figure]]] = {
    "fig3a_output_curves": output_curves,
    "fig3b_transfer_curves": transfer_curves,
}
