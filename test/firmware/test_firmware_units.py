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
