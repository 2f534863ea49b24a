# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The numbers in docstrings and documents equal the output of the code."""

import doctest
import importlib
import inspect
import subprocess
import sys
from pathlib import Path
from types import FunctionType, ModuleType

import pytest

import posfet_model
from support.paths import DOCS

PACKAGE = Path(posfet_model.__file__).parent
DOCUMENTS = DOCS
EXAMPLE = ">>> "
ROOMS = (posfet_model.device, posfet_model.amplifier, posfet_model.spice)
SPICE_COMPARISON = {
    "circuit_command",
    "circuit_comparison",
    "circuit_models",
    "model_validity",
    "comparison_table",
    "random_designs",
    "record_file",
    "recorded_runs",
    "stimuli",
}
NAMED_AS_A_WHOLE = {"as_printed", "model_comparison", "pair_settling", "reference_runs", "run_file", *SPICE_COMPARISON}
"""Modules of which the overview states the purpose, not each function."""


def _modules() -> list[str]:
    return [
        ".".join(("posfet_model", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in sorted(PACKAGE.rglob("*.py"))
        if EXAMPLE in path.read_text(encoding="utf-8")
    ]


@pytest.mark.parametrize("name", _modules())
def test_examples_of_a_module(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("path", sorted(DOCUMENTS.glob("*.md")), ids=lambda path: path.name)
def test_examples_of_a_document(path: Path) -> None:
    assert doctest.testfile(str(path), module_relative=False, encoding="utf-8").failed == 0


def test_every_function_of_the_device_is_in_the_overview() -> None:
    overview = (DOCUMENTS / "device.md").read_text(encoding="utf-8")
    modules = [getattr(room, name) for room in ROOMS for name in dir(room)]
    assert len(modules) > 20
    for module in modules:
        name = module.__name__.rpartition(".")[2]
        if name in NAMED_AS_A_WHOLE:
            continue
        for member, value in vars(module).items():
            if inspect.isfunction(value) and _shown_by(module, value) and not member.startswith("_"):
                assert f"`{name}.{member}`" in overview, f"{name}.{member}"


def _shown_by(module: ModuleType, value: FunctionType) -> bool:
    """Return whether a module, or a module of a subpackage, defines a function."""
    return value.__module__ == module.__name__ or value.__module__.startswith(f"{module.__name__}.")


def test_the_package_loads_modules_lazily_and_lists_them() -> None:
    program = (
        "import sys, posfet_model; assert 'numpy' not in sys.modules; "
        "assert posfet_model.device.film.Film.__name__ == 'Film'; "
        "assert posfet_model.Scan.__name__ == 'Scan'; assert set(posfet_model.__all__) <= set(dir(posfet_model))"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=PACKAGE.parent)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = posfet_model.nothing
