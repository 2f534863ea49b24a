# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

from pathlib import Path

import pytest

from posfet.arguments import ARGUMENTS, LAUNCH_ARGUMENTS
from posfet.graph import NODES
from posfet.parameters_document import document, main
from support.paths import DOCS

DOCUMENT = DOCS / "parameters.md"


def test_the_document_is_up_to_date() -> None:
    assert DOCUMENT.read_text(encoding="utf-8") == document(), "run: make parameters"


def test_the_command_writes_the_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "parameters.md"
    assert main(["--out", str(path)]) == 0
    assert path.read_text(encoding="utf-8") == document()
    assert capsys.readouterr().out == f"{path}: written\n"


def test_every_parameter_has_one_row_with_its_type_and_description() -> None:
    rows = [line for line in document().splitlines() if line.startswith("| `")]
    tables = [ARGUMENTS, LAUNCH_ARGUMENTS, *NODES.values()]
    assert len(rows) == sum(map(len, tables))
    parameters = [parameter for table in tables for parameter in table]
    for row, parameter in zip(rows, parameters, strict=True):
        assert row.startswith(f"| `{parameter.name}` | {parameter.type_name} | {parameter.unit} |")
        assert row.endswith(f"| {parameter.summary} |")
        assert row.count("|") == 8, "wrong number of columns"


def test_an_argument_with_the_name_of_a_node_parameter_has_its_type_default_and_range() -> None:
    of_nodes = {parameter.name: parameter for table in NODES.values() for parameter in table}
    shared = [argument for argument in ARGUMENTS if argument.name in of_nodes]
    assert len(shared) >= 12
    for argument in shared:
        parameter = of_nodes[argument.name]
        assert parameter.description in argument.description
        if argument.empty.startswith("as in params_file") and parameter.default != "":
            assert argument.default == ""
            assert argument.empty.endswith(f"otherwise {parameter.default_text}")
            if parameter.bounded or parameter.choices:
                assert parameter.allowed in argument.description
            continue
        for field in ("default", "unit", "low", "high", "choices"):
            assert getattr(argument, field) == getattr(parameter, field)
