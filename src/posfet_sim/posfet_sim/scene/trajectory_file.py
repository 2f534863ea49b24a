# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Paths of the objects of a scene from YAML."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from posfet_model.config import Section
from posfet_sim.scene.trajectories import Keyframes, Path, Pose, RandomMotion, Stroke, Taps, Vibration

TIME_MAX: Final = 1e6
"""Maximum duration of a scene [s]."""

FREQUENCY_RANGE: Final = (1e-3, 1e4)
"""Allowed frequencies [Hz]."""

MAX_HEIGHT: Final = 10e-3
"""Maximum height of an object above the surface when its path gives indentations [m]."""

ANGLE_RANGE: Final = (-3600.0, 3600.0)
"""Allowed angles [deg]: ten turns."""

_COUNT_MAX: Final = 100_000
SEED_MAX: Final = 1_000_000_000


@dataclass(frozen=True)
class Limits:
    """Limits of a path."""

    half_x: float
    """Half the extent of the cells along x [m]."""
    half_y: float
    """Half the extent of the cells along y [m]."""
    force: float
    """Maximum force [N]."""
    indentation: float | None
    """Indentation at the maximum force [m]; None when the object needs a force."""
    period: float
    """Period of the scene [s]; infinite without one."""

    def read_position(self, section: Section, prefix: str = "", margin: float = 0.0) -> tuple[float, float]:
        """Read and return a position x, y [m] that is at least `margin` [m] inside the cells of the array.

        Parameters
        ----------
        section : Section
            Section of the scene file.
        prefix : str, optional
            Beginning of the two keys.
        margin : float, optional
            Least distance from the edge of the cells [m].
        """
        x, y = ((half - margin) * 1e3 for half in (self.half_x, self.half_y))
        return section.number(f"{prefix}x_mm", -x, x) * 1e-3, section.number(f"{prefix}y_mm", -y, y) * 1e-3


def read_path(section: Section, limits: Limits) -> tuple[Path, bool]:
    """Read the path of an object, from `keyframes` or `path`.

    Parameters
    ----------
    section : Section
        Section of the object.
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
    if "path" not in section:
        return _keyframe_path(section, limits)
    if "keyframes" in section:
        raise section.error("keyframes", "must not be given together with path")
    inner = section.section("path")
    kind = inner.text("kind", tuple(_PATHS))
    by_indentation = "force_N" not in inner and "indentation_mm" in inner
    path = _PATHS[kind](inner, limits, by_indentation)
    inner.end()
    return path, by_indentation


def keyframes(section: Section, name: str) -> list[Section]:
    """Read and return a list of at least one keyframe.

    Parameters
    ----------
    section : Section
        Section of the scene file.
    name : str
        Key of the list.
    """
    sections = section.sections(name)
    if not sections:
        raise section.error(name, "must hold at least one keyframe, got none")
    return sections


def keyframe_time(keyframe: Section, before: Sequence[float], period: float) -> float:
    """Read and return the time [s] of a keyframe: after the previous one, within the period.

    Parameters
    ----------
    keyframe : Section
        Section of the keyframe.
    before : sequence of float
        Times of the previous keyframes [s].
    period : float
        Period of the scene [s].
    """
    time = keyframe.number("time_s", 0, min(period, TIME_MAX))
    if before and time <= before[-1]:
        raise keyframe.error("time_s", f"must be after {before[-1]:g}, the keyframe before, got {time:g}")
    return time


def _keyframe_path(section: Section, limits: Limits) -> tuple[Path, bool]:
    sections = keyframes(section, "keyframes")
    by_indentation = "force_N" not in sections[0] and "indentation_mm" in sections[0]
    times: list[float] = []
    values: list[Pose] = []
    for keyframe in sections:
        times.append(keyframe_time(keyframe, times, limits.period))
        x, y = limits.read_position(keyframe)
        angle = _angle(keyframe, "angle_deg", 0.0)
        values.append((x, y, angle, _load(keyframe, limits, by_indentation, -MAX_HEIGHT if by_indentation else 0.0)))
        keyframe.end()
    first, last = values[0], values[-1]
    if math.isfinite(limits.period) and first != last and (first[-1] > 0 or last[-1] > 0):
        raise sections[-1].error(
            _load_key(by_indentation),
            "a scene with a period_s must end without contact, or with the values of the first keyframe",
        )
    return Keyframes(tuple(times), tuple(values)), by_indentation


def _load_key(by_indentation: bool) -> str:
    return "indentation_mm" if by_indentation else "force_N"


def _load(section: Section, limits: Limits, by_indentation: bool, low: float = 0.0) -> float:
    """Read the load: force [N] or indentation [m]."""
    if not by_indentation:
        return section.number("force_N", low, limits.force)
    if limits.indentation is None:
        raise section.error("indentation_mm", "cannot drive a soft face, which must be given force_N")
    return section.number("indentation_mm", low * 1e3, limits.indentation * 1e3) * 1e-3


def _amplitude(section: Section, limits: Limits, by_indentation: bool, load: float) -> float:
    """Read the amplitude of a load, for which the load stays between 0 and its limit."""
    highest = min(load, (limits.indentation or 0.0 if by_indentation else limits.force) - load)
    if by_indentation:
        return section.number("amplitude_mm", 0, highest * 1e3) * 1e-3
    return section.number("amplitude_N", 0, highest)


def _angle(section: Section, name: str, default: float) -> float:
    return math.radians(section.number(name, *ANGLE_RANGE, default=default))


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
        "angle": _angle(section, "angle_deg", 0.0),
        "load": _load(section, limits, by_indentation),
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
    load = _load(section, limits, by_indentation)
    return Taps(start, contact, interval, count, x, y, _angle(section, "angle_deg", 0.0), load)


_PATHS: Final[dict[str, Callable[[Section, Limits, bool], Path]]] = {
    "sine": _sine,
    "sweep": _sweep,
    "tap": _tap,
    "slide": _slide,
    "twist": _twist,
    "random": _random,
}
