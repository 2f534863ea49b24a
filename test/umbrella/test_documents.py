# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""README and documents: their commands are valid, their examples run, and their links have targets."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from posfet.arguments import parse
from posfet.cli import COMMANDS
from posfet_driver.tools.can_cli import make_parser
from posfet_sim.commands import calibrate, score, simulate
from support.document_blocks import blocks as blocks_of
from support.document_blocks import documents
from support.paths import ROOT

REPOSITORY = ROOT
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
DOCUMENTS = documents()


def commands(program: str) -> list[list[str]]:
    """Return the arguments of each command that starts with `program`: in blocks, and in the text of the README."""
    blocks = "\n".join(block.text for path in DOCUMENTS for block in blocks_of(path) if block.language == "bash")
    inline = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", README, flags=re.DOTALL))
    lines = (line.strip() for line in [*blocks.splitlines(), *inline])
    split = (shlex.split(line, comments=True) for line in lines if line.startswith(f"{program} "))
    return [words[len(program.split()) :] for words in split]


def test_launch_commands_have_valid_arguments() -> None:
    launched = commands("ros2 launch posfet bringup.launch.py")
    assert len(launched) >= 6
    for words in launched:
        parse([word for word in words if word != "-s" and not word.startswith("web:=")])


def test_arguments_in_the_text_are_valid() -> None:
    words = re.findall(r'ARGS="([^"]+)"', README) + re.findall(r"`([a-z_]+:=[^`\s]+)`", README)
    words = [word for word in words if not word.startswith("name:=")]
    assert len(words) >= 3
    for word in words:
        parse([word])


def test_can_commands_are_accepted() -> None:
    actions = commands("posfet can")
    assert {words[0] for words in actions} == {"list", "monitor", "command", "record", "replay", "selftest", "conform"}
    for words in actions:
        make_parser().parse_args(words)


@pytest.mark.parametrize("module", [calibrate, score, simulate])
def test_commands_of_the_simulation_are_accepted(module: Any) -> None:
    name = {calibrate: "calibrate", score: "score", simulate: "sim"}[module]
    used = commands(f"posfet {name}")
    assert used
    for words in used:
        module.make_parser().parse_args(words)


def test_named_subcommands_exist() -> None:
    named = {words[0] for words in commands("posfet")}
    assert {"can", "sim", "score", "calibrate"} <= named <= set(COMMANDS)


def test_the_library_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    [stream] = [block.text for block in blocks_of(ROOT / "README.md") if block.mark.endswith("test_documents.py")]
    exec(compile(stream, "README.md", "exec"), {})
    assert re.fullmatch(r"<Contact #1 new 0\.0\d+ N at .*>\n", capsys.readouterr().out)


def anchors(path: Path) -> set[str]:
    """Return the anchors of the headings of a document, as GitHub makes them."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_links_point_to_existing_files_and_headings(path: Path) -> None:
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        linked = path.parent / name if name else path
        assert linked.exists(), f"{path.name}: no such file: {target}"
        if anchor:
            assert anchor in anchors(linked), f"{path.name}: no such heading: {target}"


def test_the_glossary_names_modules_that_exist() -> None:
    glossary = (REPOSITORY / "docs/glossary.md").read_text(encoding="utf-8")
    names = re.findall(r"`((?:posfet\w*|benchmarks)\.[\w.]+)` \|$", glossary, re.MULTILINE)
    assert len(names) >= 70
    for name in names:
        package, *parts = name.split(".")
        root = REPOSITORY if package == "benchmarks" else REPOSITORY / "src" / package
        path = root.joinpath(package, *parts)
        assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), f"no such module: {name}"


def test_each_glossary_term_is_defined_once() -> None:
    glossary = (REPOSITORY / "docs/glossary.md").read_text(encoding="utf-8")
    rows = [line for line in glossary.splitlines() if line.startswith("| ") and not line.startswith("| term")]
    terms = [row.split("|")[1].strip() for row in rows]
    assert len(terms) == len(set(terms)) >= 70


@pytest.mark.parametrize("package", ["posfet_model", "posfet_driver", "posfet_sim"])
def test_package_tables_have_the_order_of_the_import_contracts(package: str) -> None:
    tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
    settings = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    [layers] = [
        contract["layers"]
        for contract in settings["tool"]["importlinter"]["contracts"]
        if contract.get("containers") == [package]
    ]
    text = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8")
    [table] = re.findall(rf"^`{package}`:\n\n((?:\|.*\n)+)", text, re.MULTILINE)
    rows = [re.findall(r"`([\w/.]+)`", row.split("|")[1]) for row in table.splitlines()[2:]]
    documented = [{name.removesuffix("/").removesuffix(".py") for name in row} for row in rows]
    assert documented == [set(layer.split(" | ")) for layer in layers]
