# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Submodules that are imported when they are first used."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

PACKAGE = "package_of_lazy_modules"
INIT = """\
from posfet_model._lib.lazy import lazy_submodules
__getattr__, __dir__ = lazy_submodules(__name__, __path__)
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    folder = tmp_path / PACKAGE
    folder.mkdir()
    files = {"__init__": INIT, "pear": "COLOUR = 'green'", "apple": "COLOUR = 'red'", "_seed": "", "broken": "1 / 0"}
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module(PACKAGE)
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


def test_a_submodule_is_imported_on_first_use_and_no_earlier(package: ModuleType) -> None:
    assert f"{PACKAGE}.pear" not in sys.modules
    assert package.pear.COLOUR == "green"
    assert package.pear is sys.modules[f"{PACKAGE}.pear"]
    assert f"{PACKAGE}.apple" not in sys.modules


def test_the_listing_has_the_public_modules_in_order(package: ModuleType) -> None:
    assert dir(package) == ["apple", "broken", "pear"]


@pytest.mark.parametrize("name", ["plum", "_seed", "__path_of_nothing__"])
def test_other_names_are_missing_attributes(package: ModuleType, name: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{PACKAGE}' has no attribute '{name}'"):
        getattr(package, name)
    assert not hasattr(package, name)


def test_an_error_in_a_submodule_is_not_hidden(package: ModuleType) -> None:
    with pytest.raises(ZeroDivisionError):
        _ = package.broken
