"""Time of a short call, undisturbed by other programs: the least of many."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

REPEATS = 15
BLOCK = 20
"""Scans after which zeros are corrected at 1 kHz, which costs several scans: what a scan costs is a mean over them."""
BATCH_SECONDS = 2e-3
"""Time of one batch: longer than the timer's step, shorter than what the kernel gives a process at once."""


def microseconds(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the least time of `call` [us] over batches of calls."""
    begin = time.perf_counter()
    call()
    once = max(time.perf_counter() - begin, 1e-7)
    number = max(1, round(BATCH_SECONDS / once))
    least = math.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(number):
            call()
        least = min(least, time.perf_counter() - begin)
    return least / number * 1e6


def scan_microseconds(taken: Sequence[int]) -> float:
    """Return what a scan costs [us], from the times of scans in a row [ns]: the median of the means over blocks."""
    whole = len(taken) // BLOCK * BLOCK
    return float(np.median(np.reshape(taken[:whole], (-1, BLOCK)).mean(axis=1))) * 1e-3


def processor_seconds(pid: int) -> float:
    """Return the processor time [s] that all threads of a process have had, exact to the nanosecond."""
    total = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            total += int((task / "schedstat").read_text().split()[0])
        except (FileNotFoundError, ProcessLookupError):  # a thread that has just ended
            continue
    return total * 1e-9
