# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stored 40-digit tables equal the output of their generators: a sample of each is regenerated."""

import csv
import importlib.util
import sys
from typing import Any

import mpmath
import pytest

from support.sweep import DATA


def _tables() -> dict[str, Any]:
    """Return the tables of both generators; the second imports the first as a module in the same folder."""
    tables = {}
    for module in ("generate", "generate_follower"):
        spec = importlib.util.spec_from_file_location(module, DATA / f"{module}.py")
        assert spec is not None and spec.loader is not None
        loaded = sys.modules[module] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
        tables.update(loaded.TABLES)
    return tables


TABLES = _tables()


@pytest.mark.parametrize("name", TABLES)
def test_a_sample_is_reproduced_digit_by_digit(name: str) -> None:
    table = TABLES[name]
    with mpmath.workdps(2 * sys.modules["generate"].DIGITS):  # modules of other tests change it as they are imported
        _check(name, table)


def _check(name: str, table: Any) -> None:
    with (DATA / f"{name}.csv").open(newline="", encoding="ascii") as file:
        header, *stored = csv.reader(line for line in file if not line.startswith("#"))
    cases = list(table.cases())
    assert header == [*table.inputs, *table.outputs]
    assert len(stored) == len(cases)
    for index in range(0, len(cases), max(1, len(cases) // 25)):
        assert stored[index] == table.row(cases[index])
