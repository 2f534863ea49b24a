# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Run time of a short call, undisturbed by other programs: the minimum of many."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

REPEATS = 15
BLOCK = 20
"""Scans per block at 1 kHz; the cost of a scan is averaged over it, including the block maintenance."""
BATCH_SECONDS = 2e-3
"""Duration of one batch: longer than the timer resolution, shorter than a time slice of the kernel."""


def microseconds(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the minimum time of `call` [us] over batches of calls."""
    begin = time.perf_counter()
    call()
    once = max(time.perf_counter() - begin, 1e-7)
    number = max(1, round(BATCH_SECONDS / once))
    minimum = math.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(number):
            call()
        minimum = min(minimum, time.perf_counter() - begin)
    return minimum / number * 1e6


def scan_microseconds(times: Sequence[int]) -> float:
    """Return the cost of a scan [us], from the times of consecutive scans [ns]: the median of block means."""
    whole = len(times) // BLOCK * BLOCK
    return float(np.median(np.reshape(times[:whole], (-1, BLOCK)).mean(axis=1))) * 1e-3


def processor_seconds(pid: int) -> float:
    """Return the processor time [s] of all threads of a process, with nanosecond resolution."""
    total = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            total += int((task / "schedstat").read_text().split()[0])
        except (FileNotFoundError, ProcessLookupError):  # a thread that has just ended
            continue
    return total * 1e-9
