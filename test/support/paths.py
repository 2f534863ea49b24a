# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Folders that tests read: of the repository, or of the release of one package with its tests."""

from __future__ import annotations

from pathlib import Path

import pytest

_TEST = Path(__file__).resolve().parents[1]
DATA = _TEST / "data"
LAUNCH = _TEST.parent / "launch"
PACKAGE = next(folder for folder in (_TEST.parent / "src/posfet", _TEST.parent) if (folder / "package.xml").is_file())
"""The package `posfet`, or that of which a release is tested."""
EXAMPLES = _TEST.parent / "examples"
_REPOSITORY = {"ROOT": _TEST.parent, "DOCS": _TEST.parent / "docs", "SOURCES": _TEST.parent / "src"}


def __getattr__(name: str) -> Path:
    """Return a folder that only the repository has; the release of a package skips tests of it."""
    if name not in _REPOSITORY:
        raise AttributeError(name)
    if not _REPOSITORY["SOURCES"].is_dir():
        pytest.skip("needs the whole repository", allow_module_level=True)
    return _REPOSITORY[name]
