# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The interface files: each field has its meaning beside it, and each file is built."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PACKAGE = next(
    folder
    for parent in Path(__file__).parents
    for folder in (parent, parent / "src/posfet_msgs")
    if (folder / "msg").is_dir()
)
FILES = sorted([*PACKAGE.glob("msg/*.msg"), *PACKAGE.glob("srv/*.srv")])
CONVENTIONAL = {"bool success", "string message"}
"""Fields of responses that mean what they mean in std_srvs."""
FIELD = re.compile(r"[A-Za-z_/0-9]+(\[[<=0-9]*\])? +[A-Za-z_0-9]+( *= *\S+)?(?P<comment> *#.*)?")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_field_is_commented(path: Path) -> None:
    above = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        match = FIELD.fullmatch(line.strip())
        clear = match and (match["comment"] or above or "=" in line or line.strip() in CONVENTIONAL)
        if match and not clear:
            pytest.fail(f"{path.name}: no comment beside or above: {line}")
        above = line.strip() if line.strip().startswith("#") or (match and above) else ""


def test_every_file_is_built() -> None:
    built = re.findall(r"(?:msg|srv)/\w+\.(?:msg|srv)", (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8"))
    assert sorted(built) == [str(path.relative_to(PACKAGE)) for path in FILES]
