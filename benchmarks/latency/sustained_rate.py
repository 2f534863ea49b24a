# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Highest scan rate without loss between the emulated adapter and the contacts in another process."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks.latency.end_to_end import COLUMNS, attempt, row
from benchmarks.latency.rig import Measurement, Setup
from benchmarks.outcome import Cell, Outcome, Table

RATES = {
    5: (1000.0, 2000.0, 4000.0, 6000.0, 8000.0, 10000.0, 12000.0),
    16: (500.0, 890.0, 1500.0, 2000.0, 3000.0, 4000.0, 5000.0),
    32: (100.0, 235.0, 500.0, 1000.0, 1500.0, 2000.0, 2500.0),
}
"""Rates to choose from [Hz], by the side of the array."""
TRIES = 2
"""Number of attempts, as other load may disturb one."""
MAX_LATENCY = 50_000.0
"""99th percentile of the latency [us] beyond which scans accumulate: the rate is not sustained."""


def keeps_up(case: Measurement) -> bool:
    """Return whether every scan was received, and in time."""
    return case.written > 0 and case.lost == 0 and case.received == case.written and case.at(99) < MAX_LATENCY


@contextmanager
def loaded() -> Iterator[None]:
    """Run the block beside one busy process for each processor."""
    command = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(command) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def highest(size: int, window: float, rows: list[tuple[Cell, ...]], also: str = "") -> tuple[float, float]:
    """Return the highest of the rates that is sustained, by bisection, and its 99th percentile [us]; 0 if none is."""
    rates = RATES[size]
    low, high = -1, len(rates)
    latency = 0.0
    while high - low > 1:
        middle = (low + high) // 2
        sustained = False
        for _ in range(TRIES):
            case = attempt(Setup(f"posfet_{size}x{size}", rates[middle], window=window))
            rows.append(row(f"{size} x {size}, {rates[middle]:.0f} Hz{also}", case))
            sustained = sustained or keeps_up(case)
            if sustained:
                latency = case.at(99)
                break
        low, high = (middle, high) if sustained else (low, middle)
    return (rates[low], latency) if low >= 0 else (0.0, latency)


def measure(full: bool) -> Outcome:
    """Bisect for each size."""
    rows: list[tuple[Cell, ...]] = []
    window = 5.0 if full else 1.0
    values = {f"sustained_{size}x{size}_hz": highest(size, window, rows)[0] for size in RATES}
    with loaded():
        rate, latency = highest(5, window, rows, ", loaded")
    values["sustained_5x5_loaded_hz"] = rate
    if rate:  # else there is no latency to state
        values["sustained_5x5_loaded_p99_ms"] = latency * 1e-3
    tried = "; ".join(f"{size} x {size}: {', '.join(f'{rate:.0f}' for rate in rates)}" for size, rates in RATES.items())
    note = (
        f"Sustained: every scan received, nothing lost, 99 of 100 within {MAX_LATENCY / 1e3:.0f} ms, for {window:g} s, "
        "at the second attempt at the latest; loaded: beside one busy process for each processor. "
        f"Rates to choose from [Hz]: {tried}. Real buses have a lower limit: "
        "64-byte CAN FD frames at 5 Mbit/s arrive at 8 kHz at most."
    )
    return Outcome(values, [Table("Sustained rate", COLUMNS, rows, note)])
