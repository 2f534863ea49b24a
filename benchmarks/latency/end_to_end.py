# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""From the frame written by the emulated adapter to the contacts message in another process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.latency.processes import compiled_echo
from benchmarks.latency.rig import Measurement, Setup, run
from benchmarks.outcome import Outcome, Table

BASE = Setup()
SHORT = {
    "5 x 5, 1 kHz": BASE,
    "5 x 5, 1 kHz, idle": replace(BASE, touched=False),
    "5 x 5, 1 kHz, echo": replace(BASE, stack="echo"),
    "5 x 5, 1 kHz, echo, compiled": replace(BASE, stack="compiled echo"),
    "5 x 5, 1 kHz, separate": replace(BASE, stack="separate", window=2.0),
    "5 x 5, 1 kHz, messages": replace(BASE, as_bytes=False, window=2.0),
    "5 x 5, 4 kHz": replace(BASE, rate=4000.0, window=1.0),
    "32 x 32, 1 kHz": replace(BASE, sensor="posfet_32x32", window=1.0),
}
NAMED = ("5 x 5, 1 kHz", "5 x 5, 1 kHz, idle", "5 x 5, 1 kHz, echo")
COMPILED = "5 x 5, 1 kHz, echo, compiled"
RUNS = 3
COLUMNS = (
    "case",
    "p50 us",
    "p90 us",
    "p99 us",
    "jitter us",
    "ready p50 us",
    "ready p99 us",
    "CPU %",
    "received",
    "lost",
)


def full_cases() -> dict[str, Setup]:
    """Return every case: size, rate, touched and idle, composed and separate, bytes and messages."""
    cases = {}
    for size in (5, 16, 32):
        for rate in (100.0, 1000.0, 4000.0, 8000.0):
            if size * size * rate > 5e6:
                continue  # more than the emulated adapter can write
            for touched in (True, False):
                for stack in ("composed", "separate"):
                    for as_bytes in (True, False):
                        words = [f"{size} x {size}", f"{rate / 1000:g} kHz"]
                        words += ["idle"] * (not touched) + [stack] * (stack == "separate")
                        words += ["messages"] * (not as_bytes)
                        sensor = f"posfet_{size}x{size}"
                        window = 2.0 if rate < 1000.0 else 1.0
                        cases[", ".join(words)] = Setup(sensor, rate, touched, stack, as_bytes, window)
    return cases


def row(name: str, case: Measurement) -> tuple[str | int | float, ...]:
    """Return a row of the table; jitter is the standard deviation of the middle 98 %."""
    low, high = (case.at(percent) for percent in (1, 99))
    middle = case.latency[(case.latency >= low) & (case.latency <= high)]
    ready = [float(np.percentile(case.ready, percent)) for percent in (50, 99)] if len(case.ready) else ["-", "-"]
    jitter = float(middle.std()) if len(middle) else float("nan")
    received = f"{case.received} of {case.written}"
    return (
        name,
        case.at(50),
        case.at(90),
        case.at(99),
        jitter,
        *ready,
        case.cpu,
        received,
        case.lost,
    )


def attempt(setup: Setup) -> Measurement:
    """Run a case that may overload the machine: a stack that fails to start in time is a result, too."""
    try:
        return run(setup)
    except RuntimeError:
        return Measurement(np.zeros(0), np.zeros(0), float("nan"), 0, 0, 0)


def over_echo(touched: Measurement, idle: Measurement, echo: Measurement, name: str = "echo") -> dict[str, float]:
    """Return what the stack takes over what an echo of the same run takes, which other machines can compare."""
    ready, ready_idle, ready_echo = (float(np.percentile(each.ready, 50)) for each in (touched, idle, echo))
    return {
        f"ready_touched_over_{name}": ready / ready_echo,
        f"ready_idle_over_{name}": ready_idle / ready_echo,
        f"latency_p50_over_{name}": touched.at(50) / echo.at(50),
        f"latency_p99_over_{name}": touched.at(99) / echo.at(99),
        f"cpu_touched_over_{name}": touched.cpu / echo.cpu,
        f"cpu_idle_over_{name}": idle.cpu / echo.cpu,
    }


def ratio_row(name: str, case: Measurement, echoes: Sequence[Measurement]) -> tuple[str | float, ...]:
    """Return a row of ratios to each echo; "-" where there is none."""
    cells: list[str | float] = [name]
    for echo in echoes:
        if len(case.ready) and len(echo.ready):
            cells.append(float(np.percentile(case.ready, 50) / np.percentile(echo.ready, 50)))
        else:
            cells.append("-")
        cells += [case.at(50) / echo.at(50), case.at(99) / echo.at(99), case.cpu / echo.cpu]
    return tuple(cells)


def unavailable() -> str:
    """Return why the compiled echo cannot run here, '' if it can."""
    try:
        compiled_echo.compiled()
    except compiled_echo.CannotCompile as error:
        return str(error)
    return ""


def measure(full: bool) -> Outcome:
    """Measure all cases."""
    reason = unavailable()
    measured = {name: run(setup) for name, setup in SHORT.items() if not (reason and name == COMPILED)}
    if full:
        measured |= {name: attempt(setup) for name, setup in full_cases().items() if name not in SHORT}
    for name in (*NAMED, *[COMPILED] * (not reason)):
        again = [run(SHORT[name]) for _ in range(RUNS - 1)]
        measured[name] = min(measured[name], *again, key=lambda one: one.at(50))
    touched, idle, echo = (measured[name] for name in NAMED)
    values = {
        "latency_5x5_1khz_p50_us": touched.at(50),
        "latency_5x5_1khz_p90_us": touched.at(90),
        "latency_5x5_1khz_p99_us": touched.at(99),
        "ready_5x5_1khz_p50_us": float(np.percentile(touched.ready, 50)),
        "ready_5x5_1khz_p99_us": float(np.percentile(touched.ready, 99)),
        "driver_cpu_5x5_1khz_pct": touched.cpu,
        "driver_cpu_idle_pct": idle.cpu,
        "latency_echo_1khz_p50_us": echo.at(50),
        "latency_echo_1khz_p99_us": echo.at(99),
        "ready_echo_1khz_p50_us": float(np.percentile(echo.ready, 50)),
        "ready_echo_1khz_p99_us": float(np.percentile(echo.ready, 99)),
        "echo_cpu_pct": echo.cpu,
        "latency_separate_5x5_1khz_p50_us": measured["5 x 5, 1 kHz, separate"].at(50),
        "latency_messages_5x5_1khz_p50_us": measured["5 x 5, 1 kHz, messages"].at(50),
        "cpu_4khz_pct": measured["5 x 5, 4 kHz"].cpu,
        **over_echo(touched, idle, echo),
    }
    echoes = [echo]
    rows = [row(name, each) for name, each in measured.items()]
    if reason:
        rows.append((COMPILED, f"skipped: {reason}", *["-"] * (len(COLUMNS) - 2)))
    else:
        echoes.append(measured[COMPILED])
        values |= over_echo(touched, idle, echoes[1], "compiled_echo")
        values |= {
            "latency_compiled_echo_1khz_p50_us": echoes[1].at(50),
            "ready_compiled_echo_1khz_p50_us": float(np.percentile(echoes[1].ready, 50)),
            "compiled_echo_cpu_pct": echoes[1].cpu,
        }
    note = (
        f"For the first four cases the run with the smallest median of {RUNS}, as other load only adds. CPU: driver "
        "and model together, share of one core. Composed and bytes by default; a fingertip slides over the array "
        "except in idle cases. Echo: a process that only reads each frame and publishes an empty message: the cost of "
        "the machine, its wake-ups and the middleware; compiled: the same in C++. Jitter: standard deviation of the "
        "middle 98 %."
    )
    kinds = ("echo", "compiled echo")[: len(echoes)]
    columns = ("case", *(f"{what} / {kind}" for kind in kinds for what in ("ready p50", "p50", "p99", "CPU")))
    ratios = [ratio_row(name, each, echoes) for name, each in measured.items()]
    return Outcome(values, [Table("Latency", COLUMNS, rows, note), Table("Latency over an echo", columns, ratios)])
