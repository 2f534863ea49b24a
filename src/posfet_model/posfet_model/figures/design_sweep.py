# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Drawing of a sweep of designs: signal-to-noise ratio against bandwidth and power, with the Pareto front."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from posfet_model.design.sweep import SweepResult
from posfet_model.figures.style import BLUE, GREY, VERMILION, new_figure, style

_METADATA: Final = {".svg": {"Date": None, "Creator": None}, ".png": {"Software": None}, ".pdf": {"CreationDate": None}}


def front_figure(result: SweepResult) -> Figure:
    """Return the figure of a sweep: every design, and those on the Pareto front.

    Parameters
    ----------
    result : SweepResult
        The sweep.

    Returns
    -------
    Figure
        Two panels; designs that are not valid are crosses.
    """
    figure, panels = new_figure(3.4, columns=2)
    groups = (
        (~result.valid, GREY, "x", "not valid", 10),
        (result.valid & ~result.pareto, BLUE, ".", "valid", 12),
        (result.pareto, VERMILION, "D", "Pareto front", 18),
    )
    shown = (("bandwidth_hz", 1e-6, "bandwidth of the follower [MHz]"), ("power_w", 1e3, "power at rest [mW]"))
    for axes, (key, factor, text) in zip(panels, shown, strict=True):
        for mask, colour, marker, name, size in groups:
            edge: dict[str, Any] = {"facecolors": "none"} if marker == "D" else {}
            axes.scatter(
                factor * result.figures[key][mask],
                result.figures["snr_db"][mask],
                s=size,
                c=None if edge else colour,
                edgecolors=colour if edge else None,
                marker=marker,
                linewidths=0.9,
                label=name,
                **edge,
            )
        axes.set_axisbelow(True)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(text)
        axes.set_ylabel("signal-to-noise ratio [dB]")
    panels[0].legend(fontsize=8, frameon=False)
    return figure


def check_format(path: Path) -> None:
    """Raise ValueError unless the name of a plot ends in .svg, .png or .pdf."""
    if path.suffix not in _METADATA:
        raise ValueError(f"{path}: the name of a plot must end in {', '.join(_METADATA)}")


def save_front(result: SweepResult, path: Path) -> None:
    """Draw a sweep and write it, in the format of the path's suffix.

    Parameters
    ----------
    result : SweepResult
        The sweep.
    path : Path
        File, .svg, .png or .pdf.

    Raises
    ------
    ValueError
        The suffix is another one.
    OSError
        The file cannot be written.
    """
    check_format(path)
    with style():
        front_figure(result).savefig(path, dpi=200, metadata=_METADATA[path.suffix])
