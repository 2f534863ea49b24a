# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the set-up and the build show while they work."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from support.paths import ROOT

sys.path.insert(0, str(ROOT / "tools"))
import progress

sys.path.pop(0)

COLCON = [
    "Starting >>> posfet_msgs\n",
    "[ 50%] Building C object a.o\n",
    "Finished <<< posfet_msgs [11.2s]\n",
    "Starting >>> posfet_model\n",
    "Finished <<< posfet_model [1.5s]\n",
]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def seconds() -> Iterator[int]:
    """Return a clock that goes on by one second each time it is read."""
    return count()


def test_a_file_gets_plain_lines_with_the_time(seconds: Iterator[int]) -> None:
    plain = io.StringIO()
    progress.colcon(COLCON[:3], 2, progress.Step(plain, lambda: float(next(seconds))))
    assert plain.getvalue().splitlines()[-1].startswith("posfet: build: 1 of 2 packages after ")
    assert not plain.getvalue().endswith(" 0 s\n")
    assert "\r" not in plain.getvalue()


def test_each_built_package_is_one_line() -> None:
    plain = io.StringIO()
    progress.colcon(COLCON, 2, progress.Step(plain, lambda: 0.0))
    assert plain.getvalue() == "posfet: build [1/2] posfet_msgs: 11.2s\nposfet: build [2/2] posfet_model: 1.5s\n"


def test_a_terminal_shows_a_bar_that_fills() -> None:
    terminal = Terminal()
    progress.colcon(COLCON, 2, progress.Step(terminal, lambda: 0.0))
    shown = terminal.getvalue()
    full = [line.count("#") for line in shown.split("\r") if "[#" in line or "[-" in line]
    assert full == sorted(full)
    assert (full[0], full[-1]) == (0, progress.BAR)


def test_a_build_that_fails_shows_its_output_and_how_far_it_came() -> None:
    plain = io.StringIO()
    lines = [*COLCON[:2], "a.c:1: error\n", "Failed   <<< posfet_msgs [2.0s, exited with code 2]\n"]
    progress.colcon(lines, 2, progress.Step(plain, lambda: 0.0))
    assert "a.c:1: error\n" in plain.getvalue()
    assert plain.getvalue().endswith("posfet: build: 0 of 2 packages after 0 s\n")


def test_the_main_function_reads_its_input(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(COLCON)))
    assert progress.main(["2"]) == 0
    assert "posfet: build [2/2] posfet_model: 1.5s\n" in capsys.readouterr().out


def test_an_interface_file_is_parsed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POSFET_PARSED", raising=False)
    source = (ROOT / "tools/parse_once/sitecustomize.py").read_text(encoding="utf-8")
    names: dict[str, object] = {"__name__": "parse_once"}
    exec(compile(source, "sitecustomize.py", "exec"), names)
    texts: list[str] = []

    def parse(text: str, png_file: str | None = None) -> list[str]:
        texts.append(text)
        return [text, str(png_file)]

    once = names["remembering"](parse, "grammar", tmp_path / "parsed")  # type: ignore[operator]
    other = names["remembering"](parse, "grammar", tmp_path / "parsed")  # type: ignore[operator]
    assert once("one") == other("one") == ["one", "None"]
    assert once("two") == ["two", "None"]
    assert texts == ["one", "two"]
    for path in (tmp_path / "parsed").iterdir():  # a build that was killed leaves half a file
        path.write_bytes(path.read_bytes()[:5])
    assert once("one") == ["one", "None"]
    assert texts == ["one", "two", "one"]
    assert once("one", "tree.png") == ["one", "tree.png"]
