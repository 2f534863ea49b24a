# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The comparison of models and circuits as text: a table of runs, a table of loops, and what misses its target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from posfet_model.spice.circuit_comparison import LOOP_TARGETS, Comparison, RunError

_RUNS: Final = {
    "press": "press",
    "tap": "tap",
    "sine_1000_hz": "1 kHz",
    "sine_10000_hz": "10 kHz",
    "sine_100000_hz": "100 kHz",
    "sine_1000000_hz": "1 MHz",
    "up_10_mv": "+10 mV",
    "down_10_mv": "-10 mV",
    "up_50_mv": "+50 mV",
    "down_50_mv": "-50 mV",
    "up_200_mv": "+0.2 V",
    "down_200_mv": "-0.2 V",
    "up_1000_mv": "+1 V",
    "down_1000_mv": "-1 V",
}
_NAME, _CELL = 33, 9


def table(comparisons: Sequence[Comparison]) -> str:
    """Return the tables of a comparison; unchecked.

    Parameters
    ----------
    comparisons : sequence of Comparison
        Circuits and ways.

    Returns
    -------
    str
        Text of several lines.
    """
    ways = list(dict.fromkeys(part.loop.way for part in comparisons))
    blocks = []
    for way in ways:
        mine = [part for part in comparisons if part.loop.way == way]
        blocks += [f"model from: {way}", "", *_run_table(mine), "", *_loop_table(mine), ""]
    return "\n".join([*blocks, *_summary(comparisons)])


def _run_table(comparisons: Sequence[Comparison]) -> list[str]:
    head = "".join(f"{label:>{_CELL}}" for label in _RUNS.values())
    lines = ["rms error [% of full scale]; * above the target, ! not valid by the model", f"{'':{_NAME}}{head}"]
    for part in comparisons:
        by_name = {run.stimulus: run for run in part.runs}
        cells = (f"{_cell(by_name[name]) if name in by_name else '':>{_CELL}}" for name in _RUNS)
        lines.append(f"{part.loop.circuit:{_NAME}}{''.join(cells) if by_name else '  unstable: no run to compare'}")
    return lines


def _cell(run: RunError) -> str:
    return f"{run.rms_pct:.3f}{' ' if run.met else '*'}{' ' if run.valid else '!'}"


def _loop_table(comparisons: Sequence[Comparison]) -> list[str]:
    titles = ("A0 [dB]", "unity [MHz]", "margin [deg]", "overshoot [%]", "slew [V/us]", "stable", "usable")
    lines = ["ngspice / model", f"{'':{_NAME}}" + "".join(f"{title:>18}" for title in titles)]
    for part in comparisons:
        loop = part.loop
        pairs = (
            _pair(loop.gain_db, 1, 1),
            _pair(loop.unity_crossing, 1e-6, 3),
            _pair(loop.phase_margin, 1, 1),
            _pair(loop.overshoot, 100, 1),
            _pair(loop.slew_rate, 1e-6, 2),
            *(" / ".join("yes" if flag else "no" for flag in flags) for flags in (loop.stable, loop.usable)),
        )
        lines.append(f"{loop.circuit:{_NAME}}" + "".join(f"{pair:>18}" for pair in pairs))
    return lines


def _pair(values: tuple[float, float], scale: float, digits: int) -> str:
    return " / ".join(f"{scale * value:.{digits}f}" for value in values)


def _summary(comparisons: Sequence[Comparison]) -> list[str]:
    lines = ["targets: worst of all circuits, runs that meet it, of those that miss it how many the model flags"]
    ways = list(dict.fromkeys(part.loop.way for part in comparisons))
    for way in ways:
        runs = [run for part in comparisons if part.loop.way == way for run in part.runs]
        for label, kept in (
            (
                "press, tap and sines",
                [run for run in runs if run.stimulus in ("press", "tap") or "sine" in run.stimulus],
            ),
            ("steps to 50 mV", [run for run in runs if run.stimulus.endswith(("_10_mv", "_50_mv"))]),
            ("steps of 0.2 and 1 V", [run for run in runs if run.stimulus.endswith(("_200_mv", "_1000_mv"))]),
        ):
            if kept:
                lines.append(_target_line(way, label, kept))
        loops = [part.loop for part in comparisons if part.loop.way == way]
        for name, limit in LOOP_TARGETS.items():
            errors = [abs(loop.errors()[name]) for loop in loops if name in loop.errors()]
            if errors:
                met = sum(error <= limit for error in errors)
                worst = max(errors, key=lambda error: (math.isnan(error), error))
                lines.append(
                    f"{way:>10}  {name.replace('_', ' '):22} worst {worst:8.3f} of {limit:g}: {met}/{len(errors)}"
                )
        right = sum(loop.stable[0] == loop.stable[1] for loop in loops)
        wrong = sum(len(part.wrongly_valid) for part in comparisons if part.loop.way == way)
        lines.append(
            f"{way:>10}  stable or unstable     {right}/{len(loops)} right; {wrong} runs of unstable ones valid"
        )
        same = sum(loop.usable[0] == loop.usable[1] for loop in loops)
        lines.append(f"{way:>10}  usable or not          {same}/{len(loops)} as by ngspice (no target)")
    misses = [f"{part.loop.circuit}, {part.loop.way}: {miss}" for part in comparisons for miss in part.misses()]
    return [*lines, "", f"{len(misses)} missed" if misses else "all targets met", *misses]


def _target_line(way: str, label: str, runs: Sequence[RunError]) -> str:
    worst = max(runs, key=lambda run: (math.isnan(run.rms_pct), run.rms_pct / run.target_pct))
    missed = [run for run in runs if not run.met]
    flagged = sum(not run.valid for run in missed)
    return (
        f"{way:>10}  {label:22} worst {worst.rms_pct:8.3f} of {worst.target_pct:g} (max {worst.max_pct:.2f}): "
        f"{len(runs) - len(missed)}/{len(runs)}, {flagged} of {len(missed)} flagged"
    )
