# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import io
import math
import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet.lines import Lines
from posfet.snapshot import ContactView, Record, ScanCount, Snapshot, TrueContact, line
from posfet_model.config import ConfigError

TOUCH = ContactView(7, "held", 1e-3, -0.5e-3, 1.25, 0.004, 9e-6, 2.5)
SNAPSHOT = Snapshot(
    time=10.0,
    scans=1000,
    frames_lost=0,
    scans_lost=0,
    rows=2,
    cols=3,
    force=np.array([0.0, 0.1, 1.15, 0.0, math.nan, 0.0]),
    total_force=1.25,
    data_valid=True,
    contacts=(TOUCH,),
    truth=(TrueContact(1.03e-3, -0.46e-3, 1.25),),
    state="simulated board runs",
)


def test_record_counts_and_compares_with_the_scene() -> None:
    record = Record()
    assert math.isnan(record.add(SNAPSHOT))
    assert record.add(replace(SNAPSHOT, time=12.0, scans=3000)) == pytest.approx(1000.0)
    assert record.summary() == (
        "posfet: 2.0 s, 3000 scans, 1000 scans/s, 0 frames lost, 0 scans missing, 1 contact, "
        "centre-of-pressure error 0.050 mm (median), 0.050 mm (95 %)"
    )


def test_a_missed_contact_is_not_hidden() -> None:
    record = Record()
    record.add(replace(SNAPSHOT, contacts=()))
    assert record.errors == [math.inf]


def test_settling_contacts_are_not_compared() -> None:
    record = Record()
    record.add(replace(SNAPSHOT, contacts=(), data_valid=False))
    assert record.errors == []


def test_a_run_without_scans_is_reported() -> None:
    assert Record().summary() == "posfet: no scan arrived"


def test_the_line_states_force_position_and_losses() -> None:
    text = line(replace(SNAPSHOT, frames_lost=3), 10.0, 998.7)
    assert "999 scans/s" in text
    assert "#7 held 1.25 N at (+1.00, -0.50) mm" in text
    assert text.endswith("3 frames lost")


def test_the_line_has_no_minus_zero_and_says_unknown() -> None:
    text = line(replace(SNAPSHOT, total_force=-1e-4, contacts=(replace(TOUCH, x=-1e-7),)), 10.0, 998.7)
    assert "total 0.00 N" in text
    assert "at (0.00, -0.50) mm" in text
    assert "total unknown" in line(replace(SNAPSHOT, data_valid=False), 10.0, 998.7)


def test_an_uncalibrated_model_is_named_in_the_line() -> None:
    cost = "uncalibrated: forces may be off by 10%"
    assert "(uncalibrated)" in line(replace(SNAPSHOT, calibration=cost), 10.0, 998.7)
    assert "uncalibrated" not in line(SNAPSHOT, 10.0, 998.7)


class Replay:
    """Source of given snapshots, in sequence."""

    def __init__(self, *snapshots: Snapshot | None) -> None:
        self._snapshots = list(snapshots)

    def snapshot(self) -> Snapshot | None:
        return self._snapshots.pop(0)


def test_without_a_terminal_one_line_per_second_is_printed() -> None:
    stream = io.StringIO()
    later = [replace(SNAPSHOT, time=10.0 + step / 4, scans=1000 + 250 * step) for step in range(13)]
    with Lines(Replay(None, *later), stream) as lines:
        for step in range(14):
            lines.update(100.0 + step / 4)
    printed = stream.getvalue().splitlines()
    assert [text.split()[0] for text in printed] == ["1.0", "2.0", "3.0"]
    assert all("1000 scans/s" in text for text in printed)


def test_a_line_says_that_no_new_scan_came_and_nothing_of_the_old_one() -> None:
    stream = io.StringIO()
    later = [replace(SNAPSHOT, time=10.0 + step) for step in range(4)]
    with Lines(Replay(*later, replace(SNAPSHOT, time=14.0, sequence=1, scans=1001)), stream) as lines:
        for step in range(5):
            lines.update(100.0 + step)
    printed = stream.getvalue().splitlines()
    assert "total 1.25 N" in printed[0]
    assert printed[1:3] == [f"   {age}.0 s  no new scans for {age} s: simulated board runs" for age in (2, 3)]
    assert "total 1.25 N" in printed[3]


@pytest.mark.parametrize("outlived", [True, False])
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_ends_the_output_and_not_what_outlives_it(outlived: bool) -> None:
    snapshots = [replace(SNAPSHOT, time=10.0 + step, sequence=step) for step in range(4)]
    with open("/dev/full", "w", encoding="utf-8") as stream, Lines(Replay(*snapshots), stream, outlived) as lines:
        lines.update(100.0)
        assert lines.problem == ""
        context = (
            nullcontext() if outlived else pytest.raises(ConfigError, match=r"^the output cannot be written: No sp")
        )
        with context:
            lines.update(101.0)
        assert lines.problem == "the output cannot be written: No space left on device"
        lines.update(102.0)


def test_a_reader_that_ends_does_not_end_what_outlives_it() -> None:
    snapshots = [replace(SNAPSHOT, time=10.0 + step, sequence=step) for step in range(4)]
    for outlived in (True, False):
        reading, writing = os.pipe()
        os.close(reading)
        with open(writing, "w", encoding="utf-8") as stream, Lines(Replay(*snapshots), stream, outlived) as lines:
            lines.update(100.0)
            with nullcontext() if outlived else pytest.raises(BrokenPipeError):
                lines.update(101.0)
            assert lines.problem == "the output cannot be written: Broken pipe"
            lines.update(102.0)


def test_a_scan_every_two_seconds_is_never_old() -> None:
    stream = io.StringIO()
    steps = [replace(SNAPSHOT, time=10.0 + step, sequence=step // 2) for step in range(10)]
    with Lines(Replay(*steps), stream) as lines:
        for step in range(10):
            lines.update(100.0 + step)
    assert "no new scans" not in stream.getvalue()


def test_scans_that_are_counted_from_0_again_are_neither_a_negative_rate_nor_lost() -> None:
    record = Record()
    record.add(replace(SNAPSHOT, scans_lost=5))
    record.add(replace(SNAPSHOT, time=12.0, scans=3000, scans_lost=7))
    assert math.isnan(record.add(replace(SNAPSHOT, time=13.0, scans=500)))  # another calibration
    assert record.add(replace(SNAPSHOT, time=14.0, scans=1500, scans_lost=1)) == pytest.approx(1000.0)
    assert record.summary().startswith("posfet: 4.0 s, 4500 scans, 875 scans/s, 0 frames lost, 8 scans missing, ")


def test_the_count_of_scans_never_falls_though_losses_are_reported_late() -> None:
    count = ScanCount()
    assert [count.update(sequence, 0) for sequence in (0, 999, 2999)] == [1, 1000, 3000]
    assert count.update(3199, 1800) == 3000  # of those 1800 were lost
    assert count.update(5199, 1800) == 3400


def test_a_display_that_begins_later_counts_from_then_on() -> None:
    """What the stack lost before is no loss of the display's scans."""
    count = ScanCount()
    assert [count.update(100_000, 31_528), count.update(100_999, 31_528)] == [1, 1000]


def test_a_board_or_a_model_that_restarts_is_counted_on() -> None:
    count = ScanCount()
    count.update(0, 0)
    assert count.update(1099, 100) == 1000
    assert [count.update(0, 100), count.update(499, 100)] == [1001, 1500]
    assert [count.update(500, 0), count.update(999, 0), count.update(999, 0)] == [1501, 2000, 2000]
