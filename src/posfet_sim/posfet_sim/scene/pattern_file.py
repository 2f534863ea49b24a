# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Reads the paths that are no keyframes: sine, sweep, tap, slide, twist and random."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from posfet_model.config import Section
from posfet_sim.defaults import SEED_MAX
from posfet_sim.scene.keyframes import Path
from posfet_sim.scene.trajectories import RandomMotion, Stroke, Taps, Vibration
from posfet_sim.scene.trajectory_file import ANGLE_RANGE, TIME_MAX, Limits, read_angle, read_load

FREQUENCY_RANGE: Final = (1e-3, 1e4)
"""Allowed frequencies [Hz]."""

_COUNT_MAX: Final = 100_000


def read_pattern(section: Section, limits: Limits) -> tuple[Path, bool]:
    """Read the `path` of an object.

    Parameters
    ----------
    section : Section
        Section of the path.
    limits : Limits
        Limits of position, load and time.

    Returns
    -------
    tuple of (Path, bool)
        The path, and whether its load is an indentation instead of a force.

    Raises
    ------
    ConfigError
        A key is missing, unknown or out of range.
    """
    kind = section.text("kind", tuple(_PATHS))
    by_indentation = "force_N" not in section and "indentation_mm" in section
    path = _PATHS[kind](section, limits, by_indentation)
    section.end()
    return path, by_indentation


def _amplitude(section: Section, limits: Limits, by_indentation: bool, load: float) -> float:
    """Read the amplitude of a load, for which the load stays between 0 and its limit."""
    highest = min(load, (limits.indentation or 0.0 if by_indentation else limits.force) - load)
    if by_indentation:
        return section.number("amplitude_mm", 0, highest * 1e3) * 1e-3
    return section.number("amplitude_N", 0, highest)


def _press_release(section: Section, limits: Limits, by_indentation: bool, margin: float = 0.0) -> dict[str, Any]:
    """Read the common keys of the paths: times, position and load."""
    start = section.number("start_s", 0, min(limits.period, TIME_MAX))
    end = section.number("end_s", 0, min(limits.period, TIME_MAX))
    if end <= start:
        raise section.error("end_s", f"must be after start_s = {start:g}, got {end:g}")
    rise = section.number("rise_s", 0, (end - start) / 2, exclusive=True)
    x, y = limits.read_position(section, margin=margin)
    return {
        "start": start,
        "end": end,
        "rise": rise,
        "x": x,
        "y": y,
        "angle": read_angle(section, "angle_deg", 0.0),
        "load": read_load(section, limits, by_indentation),
    }


def _sine(section: Section, limits: Limits, by_indentation: bool) -> Path:
    common = _press_release(section, limits, by_indentation)
    frequency = section.number("frequency_Hz", *FREQUENCY_RANGE)
    amplitude = _amplitude(section, limits, by_indentation, common["load"])
    return Vibration(**common, amplitude=amplitude, frequency=frequency, end_frequency=frequency)


def _sweep(section: Section, limits: Limits, by_indentation: bool) -> Path:
    common = _press_release(section, limits, by_indentation)
    return Vibration(
        **common,
        amplitude=_amplitude(section, limits, by_indentation, common["load"]),
        frequency=section.number("frequency_Hz", *FREQUENCY_RANGE),
        end_frequency=section.number("end_frequency_Hz", *FREQUENCY_RANGE),
    )


def _slide(section: Section, limits: Limits, by_indentation: bool) -> Path:
    common = _press_release(section, limits, by_indentation)
    to_x, to_y = limits.read_position(section, "to_")
    strokes = section.whole("strokes", 1, _COUNT_MAX, default=1)
    return Stroke(**common, to_x=to_x, to_y=to_y, to_angle=common["angle"], strokes=strokes)


def _twist(section: Section, limits: Limits, by_indentation: bool) -> Path:
    common = _press_release(section, limits, by_indentation)
    to_angle = math.radians(section.number("to_angle_deg", *ANGLE_RANGE))
    strokes = section.whole("strokes", 1, _COUNT_MAX, default=1)
    return Stroke(**common, to_x=common["x"], to_y=common["y"], to_angle=to_angle, strokes=strokes)


def _random(section: Section, limits: Limits, by_indentation: bool) -> Path:
    reach = section.number("reach_mm", 0, min(limits.half_x, limits.half_y) * 1e3, default=0.0) * 1e-3
    common = _press_release(section, limits, by_indentation, margin=reach)
    return RandomMotion(
        **common,
        amplitude=_amplitude(section, limits, by_indentation, common["load"]),
        reach=reach,
        bandwidth=section.number("bandwidth_Hz", *FREQUENCY_RANGE),
        seed=section.whole("seed", 0, SEED_MAX),
    )


def _tap(section: Section, limits: Limits, by_indentation: bool) -> Path:
    start = section.number("start_s", 0, min(limits.period, TIME_MAX))
    interval = section.number("interval_s", 1e-3, TIME_MAX)
    contact = section.number("contact_s", 1e-4, interval)
    count = section.whole("count", 1, _COUNT_MAX)
    end = start + (count - 1) * interval + contact
    if end > min(limits.period, TIME_MAX):
        highest = math.floor((min(limits.period, TIME_MAX) - start - contact) / interval) + 1
        raise section.error("count", f"must be in [1, {highest}] to end in time, got {count}")
    x, y = limits.read_position(section)
    load = read_load(section, limits, by_indentation)
    return Taps(start, contact, interval, count, x, y, read_angle(section, "angle_deg", 0.0), load)


_PATHS: Final[dict[str, Callable[[Section, Limits, bool], Path]]] = {
    "sine": _sine,
    "sweep": _sweep,
    "tap": _tap,
    "slide": _slide,
    "twist": _twist,
    "random": _random,
}
