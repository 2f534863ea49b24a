# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Report of a calibration: one HTML file with numbers and inline SVG plots, which needs nothing else to be shown."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import NOMINAL_LEAK_PER_KELVIN_DEVIATION, Calibration
from posfet_model.config import write_text
from posfet_model.sensor.description import Sensor

CELL: Final = 44
"""Side of a taxel in a map [px], for arrays of up to ten columns; a smaller one for larger arrays."""
MAP_SIDE: Final = 440
"""Largest side of a map [px]."""
PLOT: Final = (860, 180)
"""Width and height of a plot over time [px]."""
STYLE: Final = "body{font:15px sans-serif;margin:2em;max-width:60em}td,th{padding:.15em .8em;text-align:left}"
Floats = NDArray[np.float64]


def write_report(path: Path, sensor: Sensor, calibration: Calibration) -> None:
    """Write the report of a calibration that was just fitted.

    Parameters
    ----------
    path : Path
        HTML file; an existing one is replaced.
    sensor : Sensor
        Sensor description.
    calibration : Calibration
        The calibration.

    Raises
    ------
    ConfigError
        The file cannot be written; one line.
    """
    write_text(path, report(sensor, calibration))


def report(sensor: Sensor, calibration: Calibration) -> str:
    """Return the report as HTML.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    calibration : Calibration
        The calibration.
    """
    title = html.escape(f"Calibration of {sensor.name} {sensor.serial}".strip())
    rows = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in _numbers(calibration))
    shape = sensor.layout.rows, sensor.layout.cols
    tau = np.where(calibration.dead, np.nan, calibration.leak_time_constant)
    parts = [
        f"<h1>{title}</h1><p>{html.escape(calibration.date)}</p><table>{rows}</table>",
        "<h2>Gain relative to nominal</h2>" + _map(calibration.gain.reshape(shape)),
        "<h2>Leakage time constant [s]</h2>" + _map(tau.reshape(shape)),
    ]
    residuals = calibration.residuals
    if residuals is not None and len(residuals.time):
        parts += [
            "<h2>Residual over time, RMS over the taxels, each second [mN]</h2>",
            _plot(residuals.time, [residuals.force_rms_over_time * 1e3], ["after"]),
            "<h2>Before and after [mN], logarithmic</h2>",
            _plot(
                residuals.time,
                [
                    np.log10(np.maximum(values * 1e3, 1e-3))
                    for values in (residuals.force_rms_over_time, residuals.force_rms_before_over_time)
                ],
                ["after", "before"],
                power=True,
            ),
        ]
    return (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE}</style></head>"
        f"<body>{''.join(parts)}</body></html>\n"
    )


def summary(calibration: Calibration) -> list[str]:
    """Return what a calibration has found and could not find, in lines of two columns.

    Parameters
    ----------
    calibration : Calibration
        The calibration.
    """
    numbers = _numbers(calibration)
    width = max(len(name) for name, _ in numbers)
    return [f"{name:{width}}  {value}" for name, value in numbers]


def _numbers(calibration: Calibration) -> list[tuple[str, str]]:
    """Return each finding with its name; ± is followed by its standard deviation."""
    residuals = calibration.residuals
    error = [] if residuals is None else [
        ("force error (hold-out set)",
         f"{residuals.force_rms * 1e3:.2f} mN RMS; {residuals.force_rms_before * 1e3:.2f} mN uncalibrated"),
    ]  # fmt: skip
    return [
        *error,
        *_taxel_numbers(calibration),
        *_thermal_numbers(calibration),
        *_film_numbers(calibration),
        *_bending_numbers(calibration),
    ]


def _taxel_numbers(calibration: Calibration) -> list[tuple[str, str]]:
    alive = ~calibration.dead
    gain, tau = calibration.gain[alive], calibration.leak_time_constant[alive]
    cover = zip(calibration.cover_spreads, calibration.cover_shares, strict=True)
    sizes = [f"{100 * share:.0f} % of {1e3 * spread:.2f} mm" for spread, share in cover if share]
    return [
        ("gain", f"{gain.mean():.3f} of nominal; taxels {gain.min():.3f} to {gain.max():.3f}, "
         f"each ± {100 * calibration.gain_deviation[alive].max():.2f} % or less"),
        ("leakage time constant", f"{tau.mean():.3f} s; taxels {tau.min():.3f} to {tau.max():.3f} s, "
         f"each ± {100 * calibration.leak_deviation[alive].max():.2f} % or less"),
        ("crosstalk", f"{100 * calibration.crosstalk:.2f} %"),
        ("dead taxels", ", ".join(map(str, np.flatnonzero(calibration.dead))) or "none"),
        ("spread of the cover", ", ".join(sizes) or "as the sensor file says"),
    ]  # fmt: skip


def _thermal_numbers(calibration: Calibration) -> list[tuple[str, str]]:
    numbers = []
    if calibration.thermal_time_constant is not None:
        sensors, dead = calibration.temperature_sensor_lag, calibration.temperature_sensor_dead_time
        of_which = f", {dead:.3f} s of it dead time" if dead > 0.0 else ""
        numbers.append(("thermal lag of the film", f"{calibration.thermal_time_constant:.3f} s"))
        numbers.append(("lag of the temperature sensors", f"{sensors:.3f} s{of_which}"))
    if calibration.temperature_reading_deviation > 0.0:
        deviation = 1e3 * calibration.temperature_reading_deviation
        numbers.append(("noise of the temperature sensors", f"± {deviation:.1f} mK"))
    if calibration.leak_per_kelvin_deviation < NOMINAL_LEAK_PER_KELVIN_DEVIATION:
        rate, deviation = calibration.leak_per_kelvin, calibration.leak_per_kelvin_deviation
        numbers.append(("growth of the leakage rate", f"{100 * rate:.2f} ± {100 * deviation:.2f} %/K"))
    warmth = f"{1e3 * calibration.warmth:.0f} ± {1e3 * calibration.warmth_deviation:.0f} mK"
    if not calibration.warmth_observed:
        warmth = "not observable: it needs a long hold, and a light touch beside strong ones"
    numbers.append(("temperature rise by touch", warmth))
    return numbers


def _film_numbers(calibration: Calibration) -> list[tuple[str, str]]:
    poles = zip(
        calibration.relaxation_time_constants,
        calibration.relaxation_sizes,
        calibration.relaxation_deviations,
        strict=True,
    )
    numbers = [
        (f"relaxation with {tau:g} s", f"{100 * size:.2f} ± {100 * deviation:.2f} %") for tau, size, deviation in poles
    ]
    if not numbers:
        numbers = [("relaxation and creep", "not observable: the recording has no long hold")]
    loops = zip(calibration.hysteresis_half_widths, calibration.hysteresis_weights, strict=True)
    operators = [(f"hysteresis of {1e3 * width:.0f} mN", f"weight {100 * weight:.2f} %") for width, weight in loops]
    return numbers + (operators or [("hysteresis", "not in the file")])


def _bending_numbers(calibration: Calibration) -> list[tuple[str, str]]:
    numbers = [
        (f"bending of the chip{where}", f"{1e3 * size:.2f} ± {1e3 * deviation:.2f} mN/N")
        for where, size, deviation in zip(
            ("", ", along x", ", along y", ", around the press"),
            calibration.bending,
            calibration.bending_deviation,
            strict=False,
        )
    ]
    if numbers and len(profile := calibration.bending_profile):
        numbers.append(("bending of single taxels", f"{profile.min():.2f} to {profile.max():.2f} times the first one"))
    return numbers or [("bending of the chip", "not in the file")]


def _map(values: Floats) -> str:
    """Return a map of the taxels, last row first, because y points up; the darkest is the largest."""
    rows, cols = values.shape
    side = min(CELL, MAP_SIDE // max(rows, cols))
    low, span = np.nanmin(values), max(float(np.ptp(values[np.isfinite(values)])), 1e-12)
    cells = []
    for (row, col), value in np.ndenumerate(values):
        x, y = col * side, (rows - 1 - row) * side
        shade = "#fff" if np.isnan(value) else f"hsl(210,70%,{90 - 50 * (value - low) / span:.0f}%)"
        cells.append(f'<rect x="{x}" y="{y}" width="{side}" height="{side}" fill="{shade}" stroke="#888"/>')
        if side == CELL:
            text = "dead" if np.isnan(value) else f"{value:.3f}"
            cells.append(
                f'<text x="{x + side / 2}" y="{y + side / 2 + 4}" font-size="12" text-anchor="middle">{text}</text>'
            )
    return f'<svg width="{cols * side}" height="{rows * side}">{"".join(cells)}</svg>'


def _plot(time: Floats, series: Sequence[Floats], names: Sequence[str], power: bool = False) -> str:
    """Return curves over time [s] with their range; with `power` the values are exponents of ten."""
    width, height = PLOT
    low, high = min(float(np.min(each)) for each in series), max(float(np.max(each)) for each in series)
    low = low if power else 0.0
    scale = (height - 30) / max(high - low, 1e-12)
    lines = []
    for values, name, colour in zip(series, names, ("#06c", "#c60"), strict=False):
        x = 60 + (time - time[0]) / max(float(np.ptp(time)), 1e-12) * (width - 130)
        points = " ".join(f"{a:.1f},{height - 20 - (b - low) * scale:.1f}" for a, b in zip(x, values, strict=True))
        lines.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        y = height - 20 - (values[-1] - low) * scale
        lines.append(f'<text x="{width - 62}" y="{y:.1f}" font-size="12" fill="{colour}">{name}</text>')
    for value in (low, high):
        label = f"{10**value if power else value:.3g}"
        y = height - 16 - (value - low) * scale
        lines.append(f'<text x="4" y="{y:.1f}" font-size="12">{label}</text>')
    for at, anchor, value in ((60, "start", time[0]), (width - 70, "end", time[-1])):
        lines.append(f'<text x="{at}" y="{height - 4}" font-size="12" text-anchor="{anchor}">{value:.0f} s</text>')
    return f'<svg width="{width}" height="{height}">{"".join(lines)}</svg>'
