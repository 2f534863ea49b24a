# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The fenced blocks of the documents, and what a comment in the line above says of each.

    <!-- run -->                      a test runs it, with the others of the document, in an empty folder
    <!-- run beside the stack -->     the same, while a stack with the simulated board runs
    <!-- file: press.yaml -->         the blocks that are run find it under this name
    <!-- tested by test/x.py -->      this test reads it from the document
    <!-- excerpt of examples/x.py --> each of its lines is in this file, which a test runs or reads
    <!-- not run: needs hardware -->  why no test can run it; its commands are parsed all the same
    ```python needs-hardware          the same, in the line of the fence
    <!-- output -->                   what a program prints

A block with ``>>>`` needs no comment: every document is run as a doctest. Commands that would not end by themselves are
run for `FOR`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from support.paths import ROOT

MARK = re.compile(r"<!-- (run(?: beside the stack)?|file: \S+|(?:tested by|excerpt of) \S+|not run: [^>]+|output) -->")
FOR = 2
"""Duration of commands that run until Ctrl-C, or for the time given [s]."""
ENDLESS = re.compile(
    r"^(posfet (?:bringup|view|record|can monitor|can record)\b[^#\n]*?)(?: --for \d+)?([ ]*(?:#.*)?)$", re.MULTILINE
)


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    path: Path
    line: int
    language: str
    text: str
    mark: str
    """What the comment says; '' if there is none."""

    @property
    def name(self) -> str:
        return f"{self.path.relative_to(ROOT)}:{self.line}"

    @property
    def is_doctest(self) -> bool:
        return self.language == "python" and self.text.lstrip().startswith(">>> ")


def documents() -> list[Path]:
    """Return every document for users and developers."""
    folders = (ROOT, ROOT / "docs", ROOT / "benchmarks", ROOT / "src" / "posfet_msgs")
    return sorted(path for folder in folders for path in folder.glob("*.md"))


def blocks(path: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a document."""
    lines = path.read_text(encoding="utf-8").splitlines()
    start, fence = None, ""
    for number, line in enumerate(lines):
        if start is None:
            if found := re.match(r"( *)```(\w*)( needs-hardware)?$", line):
                start, fence, language = number, found[1], found[2]
                hardware = "not run: needs hardware" if found[3] else ""
        elif line == f"{fence}```":
            marked = MARK.fullmatch(lines[start - 1].strip()) if start else None
            text = "\n".join(each.removeprefix(fence) for each in lines[start + 1 : number])
            yield Block(path, start + 1, language, text + "\n", marked[1] if marked else hardware)
            start = None
    assert start is None, f"{path}: a block is not closed"


def problem(block: Block) -> str:  # noqa: PLR0911  # one for each kind of mark
    """Return what is wrong with the mark of a block; '' if nothing is."""
    if block.is_doctest:
        return "runs as a doctest: no comment is needed" if block.mark else ""
    if not block.mark:
        return "neither run nor marked: see test/support/document_blocks.py"
    kind, _, rest = block.mark.partition(" ")
    if kind == "tested":
        return _problem_of_test(block, rest.removeprefix("by "))
    if kind == "excerpt":
        return _problem_of_excerpt(block, rest.removeprefix("of "))
    if block.mark == "output" and block.language in {"bash", "python"}:
        return "is a program, not output"
    if block.mark.startswith("run") and block.language not in {"bash", "python"}:
        return f"cannot run {block.language or 'text'}"
    return ""


def _problem_of_test(block: Block, name: str) -> str:
    path = ROOT / name
    if not path.is_file():
        return f"{name} does not exist"
    return "" if block.path.name in path.read_text(encoding="utf-8") else f"{name} does not name {block.path.name}"


def _problem_of_excerpt(block: Block, name: str) -> str:
    path = ROOT / name
    if not path.is_file():
        return f"{name} does not exist"
    known = {line.strip() for line in path.read_text(encoding="utf-8").splitlines()}
    missing = [line for line in block.text.splitlines() if line.strip() and line.strip() not in known]
    return f"{name} has no line {missing[0]!r}" if missing else ""


def program(block: Block) -> list[str]:
    """Return the words of the command that runs a block."""
    if block.language == "python":
        return [sys.executable, "-c", block.text]
    return ["bash", "-eo", "pipefail", "-c", ENDLESS.sub(rf"\1 --for {FOR}\2", block.text)]
