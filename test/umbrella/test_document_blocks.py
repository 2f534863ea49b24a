# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every fenced block of a document is run by a test, or says why not; test/stack/test_documents_run.py runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.document_blocks import Block, blocks, documents, problem, program
from support.paths import ROOT


@pytest.mark.parametrize("path", documents(), ids=lambda path: str(path.relative_to(ROOT)))
def test_every_block_is_run_or_marked(path: Path) -> None:
    problems = [f"{block.name}: {text}" for block in blocks(path) if (text := problem(block))]
    assert not problems, "\n".join(problems)


def block(language: str, mark: str, text: str = "posfet doctor\n") -> Block:
    return Block(ROOT / "README.md", 1, language, text, mark)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (block("bash", ""), "neither run nor marked"),
        (block("python", "run", ">>> 1\n1\n"), "doctest"),
        (block("bash", "tested by test/no_such_test.py"), "does not exist"),
        (block("bash", "tested by test/conftest.py"), "does not name README.md"),
        (block("yaml", "run"), "cannot run yaml"),
        (block("python", "output"), "a program"),
        (block("python", "excerpt of examples/one_executor.py", "no_such_line()\n"), "has no line"),
    ],
)
def test_a_wrong_mark_is_found(wrong: Block, words: str) -> None:
    assert words in problem(wrong)


def test_commands_that_do_not_end_are_run_for_a_while() -> None:
    text = "posfet bringup scene:=hold   # until Ctrl-C\nposfet record a.mcap --for 60\nposfet scene\n"
    expected = "posfet bringup scene:=hold --for 2   # until Ctrl-C\nposfet record a.mcap --for 2\nposfet scene\n"
    assert program(block("bash", "run", text))[-1] == expected
