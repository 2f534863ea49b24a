# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The C tests of the firmware, and that it fits a small microcontroller's rules of compilation."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from support.reference_board import FIRMWARE, make

TESTS = sorted(path.stem for path in (FIRMWARE / "tests").glob("test_*.c"))


@pytest.mark.parametrize("name", TESTS)
def test_it_passes_under_the_sanitizers(built: Path, name: str) -> None:
    make(built, f"{built}/{name}")
    done = subprocess.run([built / name], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == (FIRMWARE / "tests" / f"{name}.c").read_text().count("RUN(")


def test_the_board_uses_no_heap_no_floating_point_and_no_operating_system() -> None:
    source = "".join(path.read_text() for path in (FIRMWARE / "board").iterdir())
    included = {line.split()[1] for line in source.splitlines() if line.startswith("#include <")}
    assert included == {"<stdbool.h>", "<stddef.h>", "<stdint.h>", "<string.h>"}
    code = "\n".join(line.partition("//")[0] for line in source.splitlines())
    assert not [word for word in ("malloc", "free(", "float", "double", "printf") if word in code]
