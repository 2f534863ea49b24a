# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""No document names a path, make target, command, option, launch argument or topic that does not exist."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from posfet.arguments import ARGUMENTS, LAUNCH_ARGUMENTS
from posfet.graph import NODES
from posfet.reference_documents import commands as commands_page
from support.document_blocks import blocks, documents
from support.paths import ROOT

HISTORY = {"CHANGELOG.md"}
"""Documents that name what was."""
PAGES = [path for path in documents() if path.name not in HISTORY]
FOLDERS = ("src", "test", "docs", "tools", "examples", "benchmarks", "firmware", "launch")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z][a-z-]*):", MAKEFILE, re.MULTILINE))
[VARIABLES] = [set(words.split()) for words in re.findall(r"^VARIABLES := (.*)$", MAKEFILE, re.MULTILINE)]
PARAMETERS = {each.name for table in (ARGUMENTS, LAUNCH_ARGUMENTS, *NODES.values()) for each in table}
OTHER_ARGUMENTS = {"name", "address", "hand", "flat", "bent", "macro", "__ns", "__node", "contacts", "brain"}
"""Arguments of other launch files and of xacro, and of ROS itself."""
TOPICS = {
    "raw",
    "truth",
    "contacts",
    "image",
    "view/contacts",
    "view/image",
    "view/truth",
    "vibration",
    "wrench",
    "wrench_estimate",
    "force_image",
    "points",
    "markers",
    "info",
}
SERVICES = {"tare", "calibration", "scene", "command"}
NODE_NAMES = set(NODES)
OPTIONS_OF = {
    name: set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", text))
    for name, text in re.findall(r"^##+ (posfet [a-z ]+)\n(.*?)(?=^##|\Z)", commands_page(), re.MULTILINE | re.DOTALL)
}


def code(path: Path) -> Iterator[str]:
    """Yield the code of a document: inline, and line by line of its blocks of commands."""
    text = path.read_text(encoding="utf-8")
    for block in blocks(path):
        if block.language == "bash":
            yield from block.text.splitlines()
    outside = re.sub(r"^ *```.*?^ *```", "", text, flags=re.MULTILINE | re.DOTALL)
    yield from re.findall(r"`([^`\n]+)`", outside)


def check(path: Path, wrong: list[str]) -> None:
    assert not wrong, f"{path.relative_to(ROOT)}: " + "; ".join(wrong)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_paths_exist(path: Path) -> None:
    named = {
        word.rstrip("/")
        for words in code(path)
        for word in re.findall(rf"(?<![\w/.~$-])(?:{'|'.join(FOLDERS)})/[\w./*-]+", words)
    }
    elsewhere = re.compile(r"firmware/build/|test/test_slcan.py")  # what a build makes; python-can's
    check(path, sorted(word for word in named if not elsewhere.match(word) and not list(ROOT.glob(word))))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_make_targets_and_variables_exist(path: Path) -> None:
    wrong = []
    for words in code(path):
        found = re.match(r"make (?!-C)([a-z][a-z-]*)((?: +[A-Z]+=\S*)*)", words)
        if found:
            wrong += [] if found[1] in TARGETS else [words]
            wrong += [name for name in re.findall(r"([A-Z]+)=", found[2]) if name not in VARIABLES]
    check(path, wrong)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_and_their_options_exist(path: Path) -> None:
    wrong = []
    for words in code(path):
        found = re.match(r"posfet ((?:can )?[a-z]+)\b([^#|;&]*)", words)
        if not found or found[1] in {"can"}:
            continue
        known = OPTIONS_OF.get(f"posfet {found[1]}")
        if known is None:
            wrong.append(words)
            continue
        ours = found[2].partition("--ros-args")[0]
        wrong += [
            f"{option} in {words}"
            for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", ours)
            if option not in known | {"--help", "--version"}
        ]
    check(path, wrong)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_launch_arguments_and_parameters_exist(path: Path) -> None:
    named = {name for words in code(path) for name in re.findall(r"(?<![\w:/-])(\w+):=", words)}
    check(path, sorted(named - PARAMETERS - OTHER_ARGUMENTS))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_topics_and_services_exist(path: Path) -> None:
    named = {
        (words, name)
        for words in code(path)
        for name in re.findall(r"(?<![\w/.])/(?:tactile|hand/thumb|robot/thumb)/([a-z_]+)", words)
    }
    known = TOPICS | SERVICES | NODE_NAMES
    check(path, sorted(words for words, name in named if name not in known))


def test_what_does_not_exist_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    page = tmp_path / "page.md"
    for text, test in (
        ("`docs/no-such-page.md`", test_paths_exist),
        ("`make nothing`", test_make_targets_and_variables_exist),
        ("`make bench NO=1`", test_make_targets_and_variables_exist),
        ("`posfet dance`", test_commands_and_their_options_exist),
        ("`posfet can list --no-such-option`", test_commands_and_their_options_exist),
        ("`nothing:=1`", test_launch_arguments_and_parameters_exist),
        ("`/tactile/nothing`", test_topics_and_services_exist),
    ):
        page.write_text(text, encoding="utf-8")
        with pytest.raises(AssertionError):
            test(page)
