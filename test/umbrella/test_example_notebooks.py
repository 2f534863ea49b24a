# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The notebooks of examples/ that use the library print what is stored in them, and draw as many figures."""

from __future__ import annotations

import re
import warnings

import pytest

from support.notebooks import code_cells, run_cells, stored
from support.paths import EXAMPLES

pytest.importorskip("mcap")


def words(text: str) -> list[object]:
    """Return words, and numbers with a tolerance for other processors and versions: 5 %, and 0.01."""
    parts = re.findall(r"[-+]?\d+(?:\.\d+)?|[^\s\d]+", text)
    return [pytest.approx(float(part), rel=0.05, abs=0.011) if re.match(r"[-+]?\d", part) else part for part in parts]


@pytest.mark.parametrize(
    "name", ["first_contact", pytest.param("calibration", marks=pytest.mark.slow), "device_design", "replay"]
)
def test_the_notebook_prints_what_is_stored_in_it(name: str) -> None:
    path = EXAMPLES / f"{name}.ipynb"
    kept = [stored(cell) for cell in code_cells(path)]
    assert len(kept) >= 4
    assert any(cell.pictures for cell in kept)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = run_cells(path)
    for now, before in zip(found, kept, strict=True):
        assert before.text or before.pictures
        assert words(now.text) == words(before.text)
        assert len(now.pictures) == len(before.pictures)
