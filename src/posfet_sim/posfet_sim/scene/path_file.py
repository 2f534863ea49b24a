# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Reads the path of an object, of either kind."""

from __future__ import annotations

from posfet_model.config import Section
from posfet_sim.scene.keyframes import Path
from posfet_sim.scene.trajectory_file import Limits, read_keyframes


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
        return read_keyframes(section, limits)
    if "keyframes" in section:
        raise section.error("keyframes", "must not be given together with path")
    from posfet_sim.scene.pattern_file import read_pattern  # noqa: PLC0415  # most objects have keyframes

    return read_pattern(section.section("path"), limits)
