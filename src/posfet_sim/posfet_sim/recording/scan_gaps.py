# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans missing in a recording, by the sequence of the messages."""

from __future__ import annotations

from typing import Final

from posfet_sim.recording.cdr_reader import MessageReader
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.recorded_scans import RAW
from posfet_sim.recording.ros2msg import parse_schema

SEQUENCE: Final = "sequence"
"""Name of the field."""


class ScanGaps:
    """Counts the scans that are missing between those of one board.

    A sequence that steps back is that of a board that has restarted: what was lost before it is unknown.
    """

    def __init__(self) -> None:
        self.missing = 0
        """Number of scans missing between the first and the last one so far."""
        self._expected: int | None = None
        definitions = parse_schema(RAW, schema_text(RAW))
        names = [field.name for field in definitions[RAW]]
        definitions[RAW] = definitions[RAW][: names.index(SEQUENCE) + 1]  # the rest of a message is not read
        self._reader = MessageReader(definitions, RAW)

    def add(self, data: bytes) -> None:
        """Count what is missing before a scan.

        Parameters
        ----------
        data : bytes
            The scan, serialised.

        Raises
        ------
        ValueError
            The bytes are no scan; one line.
        """
        sequence = int(self._reader.read(data)[SEQUENCE])
        if self._expected is not None:
            self.missing += max(sequence - self._expected, 0)
        self._expected = sequence + 1
