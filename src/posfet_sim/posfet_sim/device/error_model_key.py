# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Keys of an error model file: section, name, unit and range of each field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from posfet_model.config import Section


@dataclass(frozen=True)
class Key:
    """One key of an error model file."""

    section: str
    """Section of the file."""
    name: str
    """Key in the section."""
    attribute: str
    """Field of the dataclass."""
    default: Any
    """Default in SI; assumed."""
    scale: float = 1.0
    """SI unit per unit of the file."""
    low: float = 0.0
    """Minimum in the unit of the file; unused for true or false."""
    high: float = 0.0
    """Maximum in the unit of the file; unused for true or false."""


def read_keys(section: Section, keys: Sequence[Key]) -> dict[str, Any]:
    """Return the fields that a section sets, in SI, by name.

    Parameters
    ----------
    section : Section
        Section of the file.
    keys : sequence of Key
        Keys that it may have.

    Raises
    ------
    ConfigError
        A value has a wrong type, is NaN or is out of range.
    """
    found: dict[str, Any] = {}
    for key in keys:
        if key.name in section:
            if isinstance(key.default, bool):
                found[key.attribute] = section.flag(key.name)
            elif isinstance(key.default, int):
                found[key.attribute] = section.whole(key.name, round(key.low), round(key.high))
            else:
                found[key.attribute] = section.number(key.name, key.low, key.high) * key.scale
    return found
