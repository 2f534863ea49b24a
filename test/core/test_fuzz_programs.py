# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The fuzz programs, which `make sanitize` runs, fit the library as it is."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from support.paths import SOURCES

CORE = SOURCES / "posfet_core"
PROGRAMS = sorted((CORE / "fuzz").glob("*.cpp"))
WIDEST = "fuzz_scan_path"
"""What includes most of the headers."""


@pytest.mark.parametrize(
    "program",
    [pytest.param(each, id=each.stem, marks=() if each.stem == WIDEST else pytest.mark.slow) for each in PROGRAMS],
)
def test_a_fuzz_program_compiles(program: Path) -> None:
    command = ["g++", "-std=c++17", "-fsyntax-only", f"-I{CORE / 'include'}", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
