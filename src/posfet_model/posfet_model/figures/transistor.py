# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Output and transfer curves of the transistor, before and after poling (the paper's Fig. 3a and 3b)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posfet_model._lib.types import Array
from posfet_model.device import paper
from posfet_model.device.transistor import Plane, drain_current
from posfet_model.figures.style import BLACK, BLUE, DASHED, DOTTED, GREY, SOLID, VERMILION, label, new_figure

GATE_VOLTAGES: Final = (1.0, 2.0, 3.0, 4.0)
"""Vgs of the output curves [V]."""

DRAIN_VOLTAGES: Final = (0.1, 0.5, 1.0, 2.0, 5.0)
"""Vds of the transfer curves [V]."""

_BETA = paper.channel_gain_factor(Plane.GATE)
_BEFORE = paper.THRESHOLD_VOLTAGE.value
_AFTER = _BEFORE + paper.POLING_SHIFT.value
_MILLI = 1e-3


def output_curves() -> Figure:
    """Draw Fig. 3a: drain current against drain voltage for several gate voltages, before and after poling."""
    figure, panels = new_figure(3.9, columns=2)
    drain = np.linspace(0, 6, 301)
    for axes, threshold, colour, dashes, title in _states(panels):
        for gate in GATE_VOLTAGES:
            current = _current(gate, drain, threshold)
            axes.plot(drain, current, color=colour, linestyle=dashes)
            label(axes, 5.95, current[-1] + 0.22, f"$V_{{gs}}$ = {gate:.0f} V", colour, ha="right", bbox=None)
        overdrive = np.linspace(0, GATE_VOLTAGES[-1] - threshold + 0.25, 101)
        axes.plot(overdrive, _current(threshold + overdrive, overdrive, threshold), color=GREY, linestyle=DOTTED)
        label(axes, 0.15, 9.25, "dotted: $V_{ds} = V_{gs} - V_{th}$,\nleft of it the linear region", BLACK, va="center")
        axes.set(xlabel="drain voltage $V_{ds}$ [V]", xlim=(0, 6), ylim=(0, 10), title=title)
    panels[0].set_ylabel("drain current $I_d$ [mA]")
    return figure


def transfer_curves() -> Figure:
    """Draw Fig. 3b: drain current against gate voltage for several drain voltages, before and after poling."""
    figure, panels = new_figure(3.9, columns=2)
    gate = np.linspace(-1, 4, 251)
    for axes, threshold, colour, dashes, title in _states(panels):
        for drain in DRAIN_VOLTAGES:
            current = _current(gate, drain, threshold)
            axes.plot(gate, current, color=colour, linestyle=dashes)
            label(axes, 4.08, float(current[-1]), f"{drain:g} V", colour, va="center", bbox=None, clip_on=False)
        label(axes, 4.08, float(_current(4.0, 5.0, threshold)) + 0.7, "$V_{ds}$ =", colour, va="center", bbox=None)
        axes.plot(threshold, 0, marker="o", markersize=5, color=colour, clip_on=False, zorder=6)
        label(axes, -0.9, 1.1, f"$V_{{th}}$ = {threshold:.1f} V".replace("-", "−"), colour)
        axes.set(xlabel="gate voltage $V_{gs}$ [V]", xlim=(-1, 4), ylim=(0, 10), title=title)
    panels[0].set_ylabel("drain current $I_d$ [mA]")
    return figure


def _states(panels: list[Axes]) -> Iterator[tuple[Axes, float, str, object, str]]:
    """Yield panel, threshold voltage [V], colour, dashes and title of the film before and after poling."""
    for axes, threshold, colour, dashes, when in zip(
        panels, (_BEFORE, _AFTER), (BLUE, VERMILION), (SOLID, DASHED), ("before", "after"), strict=True
    ):
        shown = f"{threshold:.1f}".replace("-", "−")
        yield axes, threshold, colour, dashes, f"{when} poling, $V_{{th}}$ = {shown} V (assumed)"


def _current(gate: float | Array, drain: float | Array, threshold: float) -> Array:
    """Return the drain current [mA], eq. (9) and (10)."""
    return np.asarray(drain_current(gate, drain, threshold, _BETA) / _MILLI, np.float64)


FIGURES: Final[dict[str, Callable[[], Figure]]] = {
    "fig3a_output_curves": output_curves,
    "fig3b_transfer_curves": transfer_curves,
}
