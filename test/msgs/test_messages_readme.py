# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The README of posfet_msgs: one complete example for each message and service."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from posfet_msgs import msg, srv
from support.paths import ROOT

README = ROOT / "src" / "posfet_msgs" / "README.md"
SECTIONS = dict(re.findall(r"^## (\w+)$(.*?)(?=^## |\Z)", README.read_text(encoding="utf-8"), re.M | re.S))
INTERFACES = {path.stem: path.suffix for path in sorted((ROOT / "src" / "posfet_msgs").glob("*/*.[ms][sr][gv]"))}


def filled(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return a message; rclpy checks the types of its fields."""
    message = kind()
    assert set(values) <= set(kind.get_fields_and_field_types()), kind
    for name, value in values.items():
        setattr(message, name, converted(value, getattr(message, name), kind.get_fields_and_field_types()[name]))
    return message


def converted(value: Any, field: Any, field_type: str) -> Any:
    """Return the value of a field, with messages in place of mappings."""
    if isinstance(value, dict):
        return filled(type(field), value)
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [filled(ELEMENTS[field_type], each) for each in value]
    return value


def elements() -> dict[str, Any]:
    from geometry_msgs.msg import Point, Pose, Vector3  # noqa: PLC0415

    return {f"sequence<geometry_msgs/{kind.__name__}>": kind for kind in (Point, Pose, Vector3)}


ELEMENTS = elements()


def test_every_message_and_service_has_a_section() -> None:
    assert set(SECTIONS) == set(INTERFACES)
    assert len(SECTIONS) == 12


@pytest.mark.parametrize("name", sorted(INTERFACES))
def test_its_example_is_complete_and_of_the_right_types(name: str) -> None:
    [text] = re.findall(r"```yaml\n(.*?)```", SECTIONS[name], re.S)
    values = yaml.safe_load(text)
    service = INTERFACES[name] == ".srv"
    kind = getattr(srv, name).Response if service else getattr(msg, name)
    filled(kind, values)
    assert list(values) == list(kind.get_fields_and_field_types())
    if service:
        [request] = re.findall(r'"(\{.*\})"', SECTIONS[name])
        filled(getattr(srv, name).Request, yaml.safe_load(request))
        assert list(yaml.safe_load(request)) == list(getattr(srv, name).Request.get_fields_and_field_types())


def test_the_migration_note_names_fields_that_are_there() -> None:
    note = README.read_text(encoding="utf-8").split("## Migration to")[1]
    rows = re.findall(r"^\| (\w+) \| (`.*?) \|", note, re.M)
    assert len(rows) == 10
    for name, text in rows:
        kind = getattr(srv, name).Request if INTERFACES[name] == ".srv" else getattr(msg, name)
        fields = re.findall(r"`(\w+)`", text)
        assert fields, name
        assert set(fields) <= set(kind.get_fields_and_field_types()), name
    for constant in re.findall(r"\b(?:STATUS|TAXEL)_\w+", note):
        assert hasattr(msg.TactileImage if constant.startswith("TAXEL") else msg.TactileRaw, constant), constant
