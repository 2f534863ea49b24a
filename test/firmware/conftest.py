# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The reference firmware, built once per run."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.reference_board import COMPILER, make


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which the firmware is built; the workers of pytest-xdist share it."""
    if COMPILER is None:
        pytest.skip("needs a C compiler and make")
    base = tmp_path_factory.getbasetemp()
    return (base.parent if base.name.startswith("popen-") else base) / "firmware"


@pytest.fixture(scope="session")
def program(built: Path) -> Path:
    """The host's process, with sanitizers."""
    make(built, f"{built}/posfet_board_checked")
    return built / "posfet_board_checked"
