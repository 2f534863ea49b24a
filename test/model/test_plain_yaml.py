# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The part of YAML that is read, and that no small file costs much."""

from __future__ import annotations

import contextlib
import importlib.util
import tracemalloc
from typing import Any

import pytest
import yaml

from posfet_model import plain_yaml
from posfet_model.plain_yaml import MAX_DEPTH, YamlError, parse
from support.paths import ROOT


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("a: 1\nb: [1.5, -2, 0x10, .inf]\n", {"a": 1, "b": [1.5, -2, 16, float("inf")]}),
        ("{a: {b: [{c: 'x y'}]}, d: }", {"a": {"b": [{"c": "x y"}]}, "d": None}),
        ("a: yes\nb: ~\nc: 'no'\n", {"a": True, "b": None, "c": "no"}),
        ("a: 1:30\n", {"a": 90}),
        ("a: [0, -0, 0.5, 012.5, 08 um, '012']\n", {"a": [0, 0, 0.5, 12.5, "08 um", "012"]}),
        ("date: 2026-01-31\ntime: 2026-99-31 12:00:00\n", {"date": "2026-01-31", "time": "2026-99-31 12:00:00"}),
        ("a: |\n  two\n  lines\n", {"a": "two\nlines\n"}),
    ],
)
def test_plain_values_are_read(text: str, value: Any) -> None:
    assert parse(text) == value


def test_the_shipped_files_mean_what_they_mean_elsewhere() -> None:
    paths = sorted((ROOT / "src").rglob("*.yaml"))
    assert len(paths) > 30
    for path in paths:
        text = path.read_text(encoding="utf-8")
        assert parse(text) == yaml.safe_load(text), path


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: &x 1\nb: *x\n", "anchors and aliases (& and *) are not allowed (line 1, column 4)"),
        ("a: *x\n", "anchors and aliases (& and *) are not allowed (line 1, column 4)"),
        ("a: !!int ''\n", "tags (!) are not allowed (line 1, column 4)"),
        ("a: !!timestamp x\n", "tags (!) are not allowed (line 1, column 4)"),
        ("a: !!python/object/apply:os.getcwd []\n", "tags (!) are not allowed (line 1, column 4)"),
        ("a: " + "9" * 5000, "a number of more than 100 characters (line 1, column 4)"),
        ("a: 1" + ":59" * 2000, "a number of more than 100 characters (line 1, column 4)"),
        ("a: 1" + ":59" * 2000 + ".5", "a number of more than 100 characters (line 1, column 4)"),
        (
            "film_permittivity: 012\n",
            "a leading zero: '012' is a number in base 8 to some and in base 10 to others; "
            "write it without the zero, or a text in quotes (line 1, column 20)",
        ),
        (
            "a: -0_7\n",
            "a leading zero: '-0_7' is a number in base 8 to some and in base 10 to others; "
            "write it without the zero, or a text in quotes (line 1, column 4)",
        ),
        ("a: 0x_\n", "'0x_' is not a number (line 1, column 4)"),
        ("a: [" * 100_000, f"nested more than {MAX_DEPTH} times"),
        ("[" * 100_000, f"nested more than {MAX_DEPTH} times (line 1, column {MAX_DEPTH + 1})"),
        ("- " * 100_000, f"nested more than {MAX_DEPTH} times"),
        ("? " * 100_000, f"nested more than {MAX_DEPTH} times"),
        ("[" + ",".join("[]" for _ in range(3000)) + "," + "a," * 60_000 + "]", "more values than a file of this size"),
        ("? [a, b]\n: 1\n", "a list or mapping as key is not text (line 1, column 3)"),
        (f"{'k' * 5000}: 1\n{'k' * 5000}: 2\n", ""),
        ("<<: {a: 1}\n", "key << is not text (line 1, column 1)"),
        ("a: 1\n---\nb: 2\n", "but found another document"),
        ("\0", "unacceptable character"),
    ],
)
def test_what_is_not_plain_is_refused_in_one_short_line(text: str, reason: str) -> None:
    with pytest.raises(YamlError) as caught:
        parse(text)
    assert str(caught.value).startswith(reason)
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)


def test_the_parser_in_python_gives_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    events = [(text, parse(text)) for text in ("a: [1, {b: ü}]\n", "x: |\n  y\n")]
    with monkeypatch.context() as patch:
        patch.delattr(yaml, "cyaml")
        pure = importlib.util.module_from_spec(importlib.util.find_spec(plain_yaml.__name__))
        pure.__spec__.loader.exec_module(pure)
    assert pure._Parser is pure._PythonParser
    assert [(text, pure.parse(text)) for text, _ in events] == events
    with pytest.raises(pure.YamlError, match="nested more than"):
        pure.parse("[" * 100_000)


@pytest.mark.parametrize("piece", ["a,", "{a: []},", "[[]],", "a: b,"])
def test_memory_is_bounded_by_the_size_of_the_text(piece: str) -> None:
    text = "[" + piece * (6_000 // len(piece)) + "]"
    tracemalloc.start()
    try:
        with contextlib.suppress(YamlError):
            parse(text)
        assert tracemalloc.get_traced_memory()[1] < 200 * len(text)
    finally:
        tracemalloc.stop()
