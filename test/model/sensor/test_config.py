# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reading of YAML: every reader, and invalid files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from posfet_model.config import ConfigError, Section, find_file, read_yaml


def section(**values: Any) -> Section:
    return Section("file.yaml", "part", values)


@pytest.mark.parametrize(
    ("read", "value", "result"),
    [
        (lambda s: s.number("x", 0, 1), 1, 1.0),
        (lambda s: s.number("x", default=3.0), 0.5, 0.5),
        (lambda s: s.numbers("x", 2, 0, 9), [1, 2.5], (1.0, 2.5)),
        (lambda s: s.whole("x", 0, 9), 9, 9),
        (lambda s: s.flag("x"), False, False),
        (lambda s: s.text("x"), "", ""),
        (lambda s: s.text("x"), "F\u00fcgel\n", "F\u00fcgel"),
        (lambda s: s.text("x", ("a", "b")), "b", "b"),
        (lambda s: s.section("x").whole("y", 0, 1), {"y": 1}, 1),
        (lambda s: [part.whole("y", 0, 9) for part in s.sections("x")], [{"y": 1}, {"y": 2}], [1, 2]),
    ],
)
def test_a_valid_value_is_read_and_no_key_is_left(read: Callable[[Section], Any], value: Any, result: Any) -> None:
    part = section(x=value)
    assert "x" in part
    value_read = read(part)
    assert value_read == result
    assert type(value_read) is type(result)
    part.end()


@pytest.mark.parametrize(
    ("read", "result"),
    [
        (lambda s: s.number("x", default=3.0), 3.0),
        (lambda s: s.whole("x", 0, 9, default=4), 4),
        (lambda s: s.flag("x", default=True), True),
        (lambda s: s.text("x", default="a"), "a"),
    ],
)
def test_a_default_replaces_a_missing_key(read: Callable[[Section], Any], result: Any) -> None:
    assert read(section()) == result


@pytest.mark.parametrize(
    ("read", "value", "said"),
    [
        (lambda s: s.number("x", 0, 1), 2, "part.x: must be a number in [0, 1], got 2"),
        (lambda s: s.number("x", 0, 1, exclusive=True), 0, "part.x: must be a number in (0, 1), got 0"),
        (lambda s: s.number("x"), float("nan"), "part.x: must be a number in (-inf, inf), got nan"),
        (lambda s: s.number("x", 0, 1), True, "part.x: must be a number in [0, 1], got True"),
        (lambda s: s.number("x", 0, 1), None, "part.x: must be a number in [0, 1], got nothing"),
        (
            lambda s: s.number("x", 0, 1),
            "1e-3",
            "part.x: must be a number in [0, 1], got the text '1e-3' (YAML wants a point: 1.0e-3)",
        ),
        (lambda s: s.numbers("x", 2), [1], "part.x: must be a list of 2 numbers in (-inf, inf), got [1]"),
        (lambda s: s.numbers("x", 2, 0, 1), [1, 2], "part.x: must be a list of 2 numbers in [0, 1], got 2"),
        (lambda s: s.whole("x", 0, 9), 1.0, "part.x: must be a whole number in [0, 9], got 1.0"),
        (lambda s: s.whole("x", 0, 9), True, "part.x: must be a whole number in [0, 9], got True"),
        (lambda s: s.flag("x"), "yes", "part.x: must be true or false, got 'yes'"),
        (lambda s: s.number("x", 0, 1), 10**400, f"part.x: must be a number in [0, 1], got 1{'0' * 56}..."),
        (
            lambda s: s.numbers("x", 1, 0, 1),
            [-(10**400)],
            f"part.x: must be a list of 1 numbers in [0, 1], got -1{'0' * 55}...",
        ),
        (lambda s: s.text("x"), 1, "part.x: must be text, got 1"),
        (lambda s: s.text("x"), "a\nb", r"part.x: must be one line of plain text, got 'a\nb'"),
        (lambda s: s.text("x"), "a\x1b[0m", r"part.x: must be one line of plain text, got 'a\x1b[0m'"),
        (lambda s: s.text("x", ("a", "b")), "c", "part.x: must be one of a, b, got 'c'"),
        (lambda s: s.section("x"), 1, "part.x: must be a mapping of keys to values, got 1"),
        (lambda s: s.sections("x"), {}, "part.x: must be a list of mappings, got {}"),
        (lambda s: s.sections("x"), [{}, 2], "part.x[1]: must be a mapping of keys to values, got 2"),
    ],
)
def test_an_invalid_value_is_reported_in_one_line(read: Callable[[Section], Any], value: Any, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(section(x=value))
    assert str(caught.value) == f"file.yaml: {said}"


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        (lambda s: s.number("x", 0, 1), "a number in [0, 1]"),
        (lambda s: s.numbers("x", 2, 0, 1), "a list of 2 numbers in [0, 1]"),
        (lambda s: s.whole("x", 0, 9), "a whole number in [0, 9]"),
        (lambda s: s.flag("x"), "true or false"),
        (lambda s: s.text("x", ("a", "b")), "one of a, b"),
        (lambda s: s.section("x"), "a mapping of keys to values"),
        (lambda s: s.sections("x"), "a list of mappings"),
    ],
)
def test_the_error_for_a_missing_key_states_what_it_must_be(read: Callable[[Section], Any], expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(section())
    assert str(caught.value) == f"file.yaml: part.x: missing, must be {expected}"


def test_an_unread_key_is_rejected_and_the_known_ones_are_listed() -> None:
    part = section(x=1, extra=2)
    part.whole("x", 0, 9)
    with pytest.raises(ConfigError, match=r"^file\.yaml: part\.extra: unknown key, known here are x$"):
        part.end()


def test_a_requested_key_is_listed_as_known_though_it_is_missing() -> None:
    part = section(speed=3)
    assert "period" not in part
    with pytest.raises(ConfigError, match=r"part.speed: unknown key, known here are period$"):
        part.end()


def test_a_long_key_is_truncated() -> None:
    with pytest.raises(ConfigError, match=r"^file\.yaml: part\.ppp") as caught:
        section(**{"p" * 1000: 1}).end()
    assert len(str(caught.value)) < 300


def test_a_long_value_is_truncated() -> None:
    with pytest.raises(ConfigError) as caught:
        section(x=list(range(1000))).flag("x")
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"a: 1\na: 2\n", "is not valid YAML: key 'a' is given twice (line 2, column 1)"),
        (b"p:\n  a: 1\n  a: 2\n", "is not valid YAML: key 'a' is given twice (line 3, column 3)"),
        (b"1: 2\n", "is not valid YAML: key 1 is not text (line 1, column 1)"),
        (b"a: [1\n", "is not valid YAML: "),
        (b"a: \x07\n", "is not valid YAML: "),
        (b"\xff\xfe\x00\xd8", "cannot be read: is not UTF-8 text"),
        (b"", "must be a mapping of keys to values, got nothing"),
        (b"- 1\n", "must be a mapping of keys to values, got [1]"),
        (b"a: !!python/object/apply:os.getcwd []\n", "is not valid YAML: "),
    ],
)
def test_a_file_that_is_no_mapping_is_reported_in_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "odd.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_opened_is_reported_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file or directory"):
        read_yaml(tmp_path / "none.yaml")
    os.mkfifo(tmp_path / "pipe")
    for endless in ("/dev/zero", tmp_path / "pipe"):
        with pytest.raises(ConfigError, match=f"^{endless}: cannot be read: not a regular file$"):
            read_yaml(endless)
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        read_yaml(tmp_path)


def test_a_shipped_file_is_found_by_name_and_any_file_by_path(tmp_path: Path) -> None:
    shipped = tmp_path / "good.yaml"
    shipped.touch()
    assert find_file("good", tmp_path, "scene") == shipped
    assert find_file(str(shipped), tmp_path / "elsewhere", "scene") == shipped
    with pytest.raises(ConfigError, match=r"^bad: no such scene; give the path of a YAML file or one of good$"):
        find_file("bad", tmp_path, "scene")
    with pytest.raises(ConfigError, match=r"^goood: no such scene; did you mean good\? give the path of"):
        find_file("goood", tmp_path, "scene")
    with pytest.raises(
        ConfigError, match=r"^bad: no such scene; give the path of a YAML file or a shipped scene \(there\)$"
    ):
        find_file("bad", tmp_path, "scene", "there")
    with pytest.raises(ConfigError, match=r"^x/bad: no such scene file$"):
        find_file("x/bad", tmp_path, "scene")
