# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Map of the error of each integration scheme over step and time constant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from posfet_model.figures.schemes import DIVERGED, SCHEMES, Scheme, largest_error, remaining_error
from posfet_model.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    PURPLE,
    SOLID,
    VERMILION,
    label,
    new_figure,
)

_STEP_DECADES: Final = (-9, 3)
_TIME_CONSTANT_DECADES: Final = (-9, 9)
_PER_DECADE: Final = 20
_LEVELS: Final = [0.0, 1e-6, 1e-3, 1e-2, 1e-1, 1.0, DIVERGED, np.inf]
_NAMES: Final = ["< 1 µV", "< 1 mV", "< 10 mV", "< 0.1 V", "< 1 V", "< 1 MV", "> 1 MV, inf"]
_SHADES: Final = ListedColormap(["#ffffff", "#e8eef5", "#bcd0e3", "#84a7c9", "#4a76a8", "#1f3f6b", "#000000"])
_FOLLOWER: Final = 105.3e-9
"""Time constant of the follower of 42.3 dB and 1.5 MHz [s]."""


def stability_map() -> Figure:
    """Draw the largest error in 200 steps after an input jump of 1 V per scheme, and the error that remains."""
    figure, panels = new_figure(8.6, rows=4, columns=2)
    for axes, scheme in zip(panels, SCHEMES, strict=False):
        _draw_map(axes, scheme)
    _draw_remainder(panels[len(SCHEMES)])
    label(panels[len(SCHEMES) - 1], 1e-3, 1.0, "below 1 µV everywhere", BLACK, ha="center", va="center", bbox=None)
    for axes in panels[: len(SCHEMES)][-3:]:
        axes.set_xlabel("step [s]")
    shades = figure.colorbar(
        panels[0].collections[0], ax=panels, location="bottom", fraction=0.035, aspect=45, pad=0.01
    )
    shades.set_ticks([k + 0.5 for k in range(len(_NAMES))], labels=_NAMES)
    shades.ax.tick_params(length=0)
    shades.set_label("largest error within 200 steps after an input jump of 1 V [V]")
    return figure


def _draw_map(axes: Axes, scheme: Scheme) -> None:
    step = np.logspace(*_STEP_DECADES, (_STEP_DECADES[1] - _STEP_DECADES[0]) * _PER_DECADE + 1)
    tau = np.logspace(
        *_TIME_CONSTANT_DECADES, (_TIME_CONSTANT_DECADES[1] - _TIME_CONSTANT_DECADES[0]) * _PER_DECADE + 1
    )
    error = largest_error(scheme, step[None, :] / tau[:, None])
    band = np.searchsorted(_LEVELS[1:-1], error, side="right")
    norm = BoundaryNorm(np.arange(len(_LEVELS)), _SHADES.N)
    axes.grid(visible=False)
    axes.pcolormesh(step, tau, band, cmap=_SHADES, norm=norm, rasterized=True)
    axes.axhline(_FOLLOWER, color=VERMILION, linestyle=DASHED, linewidth=1.2)
    axes.set(xscale="log", yscale="log", title=scheme.name, ylabel="time constant [s]")
    axes.set_xticks([1e-9, 1e-6, 1e-3, 1e0, 1e3])
    axes.set_yticks([1e-9, 1e-3, 1e3, 1e9])
    axes.minorticks_off()
    label(axes, 1.3e-9, _FOLLOWER * 12, "follower", VERMILION, fontsize=7.5)


def _draw_remainder(axes: Axes) -> None:
    ratio = np.logspace(-0.7, 4, 941)
    line_styles = [
        (VERMILION, SOLID),
        (VERMILION, DASHED),
        (VERMILION, DOTTED),
        (PURPLE, DASH_DOT),
        (BLUE, (0, (3, 1))),
        (BLUE, (0, (1, 3))),
        (GREEN, (0, (10, 3))),
    ]
    for scheme, (colour, dashes) in zip(SCHEMES, line_styles, strict=True):
        remaining = np.clip(remaining_error(scheme, ratio), 1e-9, 1e9)
        axes.plot(ratio, remaining, color=colour, linestyle=dashes, linewidth=1.4)
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    label(axes, 4, 1e6, "Euler, Heun and\nRunge-Kutta diverge", VERMILION, fontsize=7.5, va="center")
    label(axes, 4, 2e2, "clipped Euler", PURPLE, fontsize=7.5)
    label(axes, 8000, 1e-6, "trapezoidal\nrings", BLUE, fontsize=7.5, ha="right", va="center", bbox=None)
    label(axes, 1.6, 3e-5, "exact and\nbackward Euler:\nno error left", BLACK, fontsize=7.5, ha="right", va="center")
    axes.set(
        xscale="log",
        yscale="log",
        ylim=(1e-9, 1e9),
        xlim=(0.01, 1e4),
        title="remaining error after 200 steps",
        xlabel="step / time constant [1]",
        ylabel="error [V]",
    )
    axes.set_yticks([1e-9, 1e-6, 1e-3, 1e0, 1e3, 1e6, 1e9])


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"stability": stability_map}
