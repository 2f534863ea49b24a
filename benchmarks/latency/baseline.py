# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stack compared with a baseline implementation (`baseline_stack`): same board, scene, rate and listener."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.latency.end_to_end import COLUMNS, row
from benchmarks.latency.rig import Setup, run
from benchmarks.latency.sustained_rate import keeps_up
from benchmarks.outcome import Cell, Outcome, Table

RATES = (1000.0, 250.0)
"""Scan rates [Hz]; the named ratios are of the first that the baseline implementation sustains, else of the last. A
short run ends there."""


def measure(full: bool) -> Outcome:
    """Measure both at the same rates, one after the other."""
    rows: list[tuple[Cell, ...]] = []
    values: dict[str, float] = {}
    for rate in RATES:
        base = Setup(rate=rate, window=5.0 if full else 2.0)
        ours, separate = run(base), run(replace(base, stack="separate"))
        rows += [
            row(f"this stack, {rate:.0f} Hz, composed", ours),
            row(f"this stack, {rate:.0f} Hz, separate", separate),
        ]
        name = f"baseline implementation, {rate:.0f} Hz"
        try:
            baseline = run(replace(base, stack="baseline"))
        except RuntimeError:
            # At a rate far beyond what it sustains, it may publish nothing at all.
            if rate == RATES[-1]:
                raise
            rows.append((name, *["-"] * (len(COLUMNS) - 3), "no message", "-"))
            continue
        rows.append(row(name, baseline))
        ratios = {
            "ordinary_stack_latency_ratio": baseline.at(50) / ours.at(50),
            "ordinary_stack_cpu_ratio": baseline.cpu / ours.cpu,
            "ordinary_stack_latency_ratio_separate": baseline.at(50) / separate.at(50),
            "ordinary_stack_cpu_ratio_separate": baseline.cpu / separate.cpu,
        }
        if not values and (keeps_up(baseline) or rate == RATES[-1]):
            values = ratios | {"ordinary_stack_rate_hz": rate, "ordinary_stack_latency_p50_us": baseline.at(50)}
            if not full:
                break
    note = (
        f"The named ratios are those at {values['ordinary_stack_rate_hz']:.0f} Hz, the highest rate here that the "
        "baseline implementation sustains. Its lost frames are only those that the adapter dropped: it does not "
        "count losses itself."
    )
    return Outcome(values, [Table("This stack and the baseline implementation", COLUMNS, rows, note)])
