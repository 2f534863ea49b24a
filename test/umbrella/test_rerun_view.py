# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Snapshots in rerun. What needs the package rerun-sdk, which is optional, is skipped where it is not installed."""

from __future__ import annotations

import argparse
import re
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from posfet.array_view import ArrayView
from posfet.rerun_view import add_rerun_arguments, rerun_view
from posfet.snapshot import ContactView, Snapshot, TrueContact
from posfet_model.config import ConfigError
from support.paths import DOCS

ARRAY = ArrayView("posfet_2x3", "", True, 2, 3, (1.5e-3, 1.5e-3), np.inf, "x", 10.0, 0.05, 1000.0)
SNAPSHOTS = 3
STARTED = 1_700_000_000_000_000_001
"""A time [ns] that a double cannot hold."""


class Source:
    """Gives another snapshot each time, and says when enough have been taken."""

    def __init__(self) -> None:
        self.taken = 0
        self.enough = threading.Event()

    def snapshot(self) -> Snapshot | None:
        self.taken += 1
        if self.taken == 1:
            return None  # before the first scan
        if self.taken > SNAPSHOTS + 2:
            self.enough.set()
        sequence = min(self.taken - 1, SNAPSHOTS)  # then the stack stands still
        return Snapshot(
            time=float(sequence),
            scans=sequence,
            frames_lost=0,
            scans_lost=0,
            rows=2,
            cols=3,
            force=np.arange(6.0),
            total_force=15.0,
            data_valid=True,
            contacts=(ContactView(7, "held", 1.5e-3, -0.75e-3, 1.0, 0.1, 1e-6, 0.5),),
            truth=(TrueContact(1.5e-3, -0.75e-3, 1.0),),
            total_standard_deviation=0.5,
            sequence=sequence,
            stamp=STARTED + sequence * 1_000_000,
        )


def test_nothing_happens_without_the_options() -> None:
    source = Source()
    with rerun_view([("tactile", source, lambda: ARRAY)], False, None):
        pass
    assert source.taken == 0


def test_without_the_package_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with (
        pytest.raises(ConfigError, match="pip install rerun-sdk"),
        rerun_view([("tactile", Source(), lambda: ARRAY)], True, None),
    ):
        pass


def test_the_document_uses_options_that_exist() -> None:
    parser = argparse.ArgumentParser()
    add_rerun_arguments(parser)
    options = [word for action in parser._actions for word in action.option_strings if "rerun" in word]
    used = re.findall(
        r"^posfet view.*?(--rerun[a-z-]*)", (DOCS / "displays.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert set(used) == set(options)


def columns(path: Path) -> dict[str, list]:
    """Return the columns of a file of rerun, without its index."""
    chunks = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk").RrdReader(str(path)).stream()
    found: dict[str, list] = {}
    for chunk in chunks:
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            column = batch.column(name)
            known = column.cast("int64") if name in {"acquired", "log_time"} else column
            found.setdefault(f"{chunk.entity_path}:{name}", []).extend(known.to_pylist())
    return found


def test_a_file_has_forces_contacts_and_times(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    path = tmp_path / "run.rrd"
    source = Source()
    with rerun_view([("tactile", source, lambda: ARRAY)], False, str(path)):
        assert source.enough.wait(60.0)
    found = columns(path)
    assert found["/tactile/total_force:Scalars:scalars"] == [[15.0]] * SNAPSHOTS, sorted(found)
    assert found["/tactile/force/contacts:Points2D:positions"] == [[[2.5, 1.5]]] * SNAPSHOTS  # y points up
    image = np.array(found["/tactile/force:DepthImage:buffer"][0][0], np.uint8).view(np.float32).reshape(2, 3)
    np.testing.assert_array_equal(image, [[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]])
    assert found["/tactile/force/contacts:Points2D:labels"] == [["#7 1.00 N at (+1.50, -0.75) mm"]] * SNAPSHOTS
    times = [STARTED + number * 1_000_000 for number in range(1, SNAPSHOTS + 1)]
    assert found["/tactile/total_force:acquired"] == times


def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    sensors = [("tactile", Source(), lambda: ARRAY)]
    with (
        pytest.raises(ConfigError, match="cannot be opened"),
        rerun_view(sensors, False, str(tmp_path / "no" / "run.rrd")),
    ):
        pass
