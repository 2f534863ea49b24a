# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The blocks of the documents that are marked to be run work as printed, one after another, in an empty folder.

Commands beside a running stack end after some seconds, whether the machine was fast enough or not: these are `slow`.
"""

from __future__ import annotations

import os
import subprocess
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from support.bringup_process import needs_installation, running
from support.document_blocks import Block, blocks, documents, program
from support.expectations import TIMEOUT
from support.paths import ROOT

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]
BESIDE = "run beside the stack"
RUN = [path for path in documents() if any(each.mark.startswith("run") for each in blocks(path))]


def needed(path: Path) -> Any:
    """Return the parameter of a document."""
    beside = any(block.mark == BESIDE for block in blocks(path))
    return pytest.param(path, id=path.name, marks=[pytest.mark.slow] if beside else [])


@pytest.mark.parametrize("path", [needed(path) for path in RUN])
def test_what_the_document_says_works(path: Path, tmp_path: Path) -> None:
    for name in ("tools", ".venv", "install", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1"}
    found = list(blocks(path))
    last = max((number for number, each in enumerate(found) if each.mark == BESIDE), default=-1)
    with ExitStack() as stack:
        if last >= 0:
            started = stack.enter_context(running())
            assert "scans/s" in started.stdout.readline()
        for number, block in enumerate(found):
            if block.mark.startswith("file: "):
                (tmp_path / block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
            if not block.mark.startswith("run"):
                continue
            if number > last:
                stack.close()
            result = run(block, tmp_path, environment)
            assert result.returncode == 0, f"{block.name}: {result.stdout[-2000:]}{result.stderr[-2000:]}"


def run(block: Block, folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        program(block), cwd=folder, env=environment, capture_output=True, text=True, timeout=5 * TIMEOUT, check=False
    )
