# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans missing in a recording."""

from __future__ import annotations

import pytest

from posfet_sim.recording.cdr import serialise
from posfet_sim.recording.message_definitions import message_fields
from posfet_sim.recording.recorded_scans import RAW
from posfet_sim.recording.scan_gaps import ScanGaps


def scan(sequence: int, frame_id: str = "tactile_array") -> bytes:
    values = {field.name: [] if field.many else 0 for field in message_fields(RAW)}
    header = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": frame_id}
    return serialise(RAW, {**values, "header": header, "sequence": sequence, "counts": [1, 2, 3]})


@pytest.mark.parametrize(
    ("sequences", "missing"),
    [
        ([], 0),
        ([7], 0),
        ([7, 8, 9], 0),
        ([7, 9, 12], 3),
        ([7, 7, 8], 0),
        ([2**40, 2**40 + 2], 1),
        ([500, 0, 1, 3], 1),
    ],
    ids=["none", "one", "all", "gaps", "a duplicate", "wide", "a restart"],
)
def test_gaps_in_the_sequence_are_counted(sequences: list[int], missing: int) -> None:
    gaps = ScanGaps()
    for sequence in sequences:
        gaps.add(scan(sequence))
    assert gaps.missing == missing


def test_the_frame_may_have_a_name_of_any_length() -> None:
    gaps = ScanGaps()
    for sequence, name in enumerate(("", "a", "ab", "abc", "abcd", "abcde")):
        gaps.add(scan(3 * sequence, name))
    assert gaps.missing == 10


def test_other_bytes_are_refused() -> None:
    with pytest.raises(ValueError, match="posfet_msgs/TactileRaw: the message is too short"):
        ScanGaps().add(scan(0)[:12])
