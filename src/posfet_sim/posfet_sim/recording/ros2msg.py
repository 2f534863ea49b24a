# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The language of ROS 2 message definitions: fields of a message, and the schemas that MCAP files carry (`ros2msg`)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

PRIMITIVES: Final = frozenset({
    "bool", "byte", "char", "string", "float32", "float64",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
})  # fmt: skip
RULE: Final = "=" * 80
"""Line between the definitions of a schema."""

DEEPEST: Final = 32
"""Limit for messages within messages."""

_FIELD: Final = re.compile(r"^([\w/]+)(?:<=\d{1,9})?(\[(<=)?(\d{0,9})\])?\s+(\w+)(?:\s+[^=\s].*)?$", re.ASCII)
_CONSTANT: Final = re.compile(r"^[\w/]+(?:<=\d+)?\s+\w+\s*=")
_HEADING: Final = re.compile(r"^MSG: *([\w/]+)\s*$", re.ASCII)


@dataclass(frozen=True)
class Field:
    """One field of a message."""

    name: str
    """Name of the field."""
    type: str
    """Primitive type, or package/Name."""
    many: bool
    """Whether it is a sequence or an array."""
    length: int | None = None
    """Length of an array; None for a sequence, whose length is in the message."""


Definitions = Mapping[str, tuple[Field, ...]]
"""Fields of messages by the type package/Name."""


def short_name(name: str) -> str:
    """Return the type package/Name of package/msg/Name."""
    return name.replace("/msg/", "/")


def fields(name: str, text: str) -> tuple[Field, ...]:
    """Return the fields of a message in their order, without constants.

    Parameters
    ----------
    name : str
        Type of the message, package/Name.
    text : str
        Its definition.

    Raises
    ------
    ValueError
        A field has an unsupported type; one line.
    """
    result = []
    for line in text.splitlines():
        words = line.partition("#")[0].strip()
        if not words or _CONSTANT.match(words):
            continue
        match = _FIELD.match(words)
        if not match or match[1] == "wstring":
            raise ValueError(f"{name}: field '{words[:80]}' has an unsupported type")
        kind, many, bounded, length, field = match.groups()
        if kind not in PRIMITIVES:
            kind = short_name(kind) if "/" in kind else f"{name.partition('/')[0]}/{kind}"
        fixed = int(length) if length and not bounded else None
        result.append(Field(field, kind, bool(many), fixed))
    return tuple(result)


def parse_schema(name: str, text: str) -> dict[str, tuple[Field, ...]]:
    """Return the fields of a message and of all messages in it.

    Parameters
    ----------
    name : str
        Type of the message, package/Name.
    text : str
        Schema in the MCAP encoding `ros2msg`.

    Raises
    ------
    ValueError
        A definition is missing, empty, contains itself, or has an unsupported field; one line.
    """
    found: dict[str, list[str]] = {name: []}
    current = found[name]
    for line in text.splitlines():
        heading = _HEADING.match(line)
        if heading:
            current = found.setdefault(short_name(heading[1]), [])
        elif not line.startswith("====="):
            current.append(line)
    known = {each: fields(each, "\n".join(lines)) for each, lines in found.items()}
    _check(name, known, (), set())
    return known


def _check(name: str, known: Definitions, within: tuple[str, ...], good: set[str]) -> None:
    """Raise ValueError unless every type in a message is defined, has fields and does not contain itself."""
    if name in within:
        raise ValueError(f"{name}: contains itself")
    if len(within) == DEEPEST:
        raise ValueError(f"{name}: is nested more than {DEEPEST} times")
    if not known.get(name):
        raise ValueError(f"{name}: {'has no fields' if name in known else 'is not defined'}")
    for inner in {field.type for field in known[name]} - PRIMITIVES - good:
        _check(inner, known, (*within, name), good)
    good.add(name)
