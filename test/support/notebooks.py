# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Runs the cells of a notebook without Jupyter, and stores what they show: ``python -m support.notebooks FILE``."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("agg")

import matplotlib.pyplot as plt  # with the backend chosen, whatever the machine has

DPI = 80
"""Resolution of the stored figures [1/inch]."""


def code_cells(path: Path) -> list[dict[str, Any]]:
    """Return the code cells of a notebook."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


@dataclass(frozen=True)
class Result:
    """What a cell does that a reader sees."""

    text: str
    pictures: list[str]
    """Figures as PNG, in base64."""


def stored(cell: dict[str, Any]) -> Result:
    """Return what a cell printed and drew when it was stored."""
    pictures = [output["data"]["image/png"] for output in cell["outputs"] if "data" in output]
    return Result("".join("".join(output.get("text", ())) for output in cell["outputs"]), pictures)


def run_cells(path: Path) -> list[Result]:
    """Return what each code cell prints and draws, run one after the other in one namespace."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    results = []
    for cell in code_cells(path):
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile("".join(cell["source"]), str(path), "exec"), namespace)
        results.append(Result(out.getvalue(), list(drawn())))
    return results


def drawn() -> Iterator[str]:
    """Yield the open figures as PNG in base64, and close them, as a notebook does at the end of a cell."""
    for number in plt.get_fignums():
        picture = io.BytesIO()
        plt.figure(number).savefig(picture, format="png", dpi=DPI)
        plt.close(number)
        yield base64.b64encode(picture.getvalue()).decode("ascii")


def store(path: Path) -> None:
    """Run the cells and store what they print and draw."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, (cell, result) in enumerate(zip(cells, run_cells(path), strict=True), 1):
        cell["execution_count"] = count
        lines = result.text.splitlines(keepends=True)
        cell["outputs"] = [{"name": "stdout", "output_type": "stream", "text": lines}] if lines else []
        for picture in result.pictures:
            cell["outputs"].append({"output_type": "display_data", "data": {"image/png": picture}, "metadata": {}})
    path.write_text(json.dumps(notebook, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        store(Path(name))
