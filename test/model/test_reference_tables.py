"""The stored 40-digit tables are what their generator makes: a sample of each is made again."""

import csv
import importlib.util
import sys

import pytest
from model.sweep import DATA

_spec = importlib.util.spec_from_file_location("device_tables", DATA / "generate.py")
assert _spec is not None and _spec.loader is not None
_generate = importlib.util.module_from_spec(_spec)
sys.modules[_spec.name] = _generate
_spec.loader.exec_module(_generate)


@pytest.mark.parametrize("name", _generate.TABLES)
def test_a_sample_is_made_again_digit_by_digit(name: str) -> None:
    table = _generate.TABLES[name]
    with (DATA / f"{name}.csv").open(newline="", encoding="ascii") as file:
        header, *stored = csv.reader(line for line in file if not line.startswith("#"))
    cases = list(table.cases())
    assert header == [*table.inputs, *table.outputs]
    assert len(stored) == len(cases)
    for index in range(0, len(cases), max(1, len(cases) // 25)):
        assert stored[index] == table.row(cases[index])
