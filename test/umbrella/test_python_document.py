# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The blocks of docs/python.md run, one after the other, as a reader would type them."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import pytest

from support.paths import DOCS

pytest.importorskip("mcap")
pytest.importorskip("gymnasium")

TEXT = (DOCS / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python([^\n]*)\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)


def test_the_blocks_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {}
    printed = []
    for number, (mark, block) in enumerate(BLOCKS, 1):
        code = compile(block, f"docs/python.md, block {number}", "exec")
        if mark.strip() == "needs-hardware":
            continue
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(code, namespace)
        printed.append(out.getvalue())
    assert printed[0].startswith("#1: 0.0")
    assert any(text.startswith("press_slid_lift: no such scene; did you mean press_slide_lift?") for text in printed)
    assert "False 0 (25,)\n" in printed
    assert all(printed)


def test_only_what_opens_a_port_needs_hardware() -> None:
    marked = [block for mark, block in BLOCKS if mark]
    assert all("/dev/tty" in block for block in marked)
    assert len(marked) == 1
