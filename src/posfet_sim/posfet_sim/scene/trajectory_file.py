# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Paths of the objects of a scene from YAML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from posfet_model.config import Section
from posfet_sim.scene.keyframes import Keyframes, Pose

TIME_MAX: Final = 1e6
"""Maximum duration of a scene [s]."""

MAX_HEIGHT: Final = 10e-3
"""Maximum height of an object above the surface when its path gives indentations [m]."""

ANGLE_RANGE: Final = (-3600.0, 3600.0)
"""Allowed angles [deg]: ten turns."""


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


def read_keyframes(section: Section, limits: Limits) -> tuple[Keyframes, bool]:
    """Read the `keyframes` of an object.

    Parameters
    ----------
    section : Section
        Section of the object.
    limits : Limits
        Limits of position, load and time.

    Returns
    -------
    tuple of (Keyframes, bool)
        The path, and whether its load is an indentation instead of a force.

    Raises
    ------
    ConfigError
        A key is missing, unknown or out of range.
    """
    sections = keyframes(section, "keyframes")
    by_indentation = "force_N" not in sections[0] and "indentation_mm" in sections[0]
    times: list[float] = []
    values: list[Pose] = []
    for keyframe in sections:
        times.append(keyframe_time(keyframe, times, limits.period))
        x, y = limits.read_position(keyframe)
        angle = read_angle(keyframe, "angle_deg", 0.0)
        values.append(
            (x, y, angle, read_load(keyframe, limits, by_indentation, -MAX_HEIGHT if by_indentation else 0.0))
        )
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


def read_load(section: Section, limits: Limits, by_indentation: bool, low: float = 0.0) -> float:
    """Read and return a load: force [N] or indentation [m].

    Parameters
    ----------
    section : Section
        Section of the scene file.
    limits : Limits
        Limits of the load.
    by_indentation : bool
        Whether it is an indentation.
    low : float, optional
        Smallest load allowed [N or m].
    """
    if not by_indentation:
        return section.number("force_N", low, limits.force)
    if limits.indentation is None:
        raise section.error("indentation_mm", "cannot drive a soft face, which must be given force_N")
    return section.number("indentation_mm", low * 1e3, limits.indentation * 1e3) * 1e-3


def read_angle(section: Section, name: str, default: float) -> float:
    """Read and return an angle [rad].

    Parameters
    ----------
    section : Section
        Section of the scene file.
    name : str
        Its key.
    default : float
        Angle where the key is missing [deg].
    """
    return math.radians(section.number(name, *ANGLE_RANGE, default=default))
