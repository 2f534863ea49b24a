# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charts as reproducible SVG files."""

from __future__ import annotations

from pathlib import Path

from benchmarks.outcome import Chart


def draw(chart: Chart, folder: Path) -> Path:
    """Write one chart and return its path."""
    import matplotlib as mpl  # noqa: PLC0415  # takes half a second to load, only needed here

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "posfet"
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    for index, (label, points) in enumerate(chart.series.items()):
        x, y, texts = zip(*points, strict=True)
        joined = "-" if len(points) > 1 else ""
        axes.plot(x, y, f"{'osD^vP*X'[index % 8]}{joined}", label=label, markersize=4, linewidth=0.8)
        for position, text in zip(zip(x, y, strict=True), texts, strict=True):
            axes.annotate(text, position, textcoords="offset points", xytext=(4, 3), fontsize=7)
    axes.set(xscale="log", yscale="log", xlabel=chart.x_label, ylabel=chart.y_label, title=chart.title)
    axes.grid(which="major", alpha=0.3)
    axes.legend(fontsize=8)
    path = folder / f"{chart.name}.svg"
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return path
