# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of a session into an MCAP file, as `posfet record` and `posfet sim` write them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from posfet.sessions.frames import GroundTruth
from posfet_model.sensor.scan import Scan
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.scan_messages import RAW, TRUTH, ScanMessage, TruthMessage

NAMESPACE: Final = "tactile"
"""Namespace of the topics."""


def write_scans(path: Path, scans: Iterable[tuple[Scan, GroundTruth | None]], rows: int, cols: int) -> int:
    """Write scans, and the ground truth of those that have one, and return the number of scans.

    Parameters
    ----------
    path : Path
        File to write; it must not exist.
    scans : iterable of (Scan, GroundTruth or None)
        Scans with their ground truth.
    rows : int
        Rows of the array.
    cols : int
        Columns of the array.

    Raises
    ------
    ConfigError
        The file cannot be written, or a package is missing; one line.
    """
    schemas = {name: schema_text(name) for name in (RAW, TRUTH)}
    scan_message, truth_message = ScanMessage(rows, cols), TruthMessage(rows, cols)
    count = 0
    file = MessageFile(path, "posfet")
    try:
        raw = file.add_topic(f"/{NAMESPACE}/raw", RAW, schemas[RAW])
        true: int | None = None
        for scan, truth in scans:
            count += 1
            file.add(raw, scan.stamp, scan_message.fill(scan), scan.sequence)
            if truth is not None:
                if true is None:
                    true = file.add_topic(f"/{NAMESPACE}/truth", TRUTH, schemas[TRUTH])
                flat = replace(truth, force=truth.force.ravel(), taxel_status=truth.taxel_status.ravel())
                file.add(true, scan.stamp, truth_message.fill(flat, scan), scan.sequence)
    finally:
        file.close()
    return count
