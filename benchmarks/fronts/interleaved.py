# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Processor times of several calls in turn, so that load of the machine disturbs all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from benchmarks.fronts.front import Choice

BATCH = 1.5e-3
"""Duration of one batch [s]: many ticks of the timer, less than a time slice of the kernel."""


def interleaved(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, tuple[float, ...]]:
    """Return the processor time of each call [s] in each repetition.

    Short calls are repeated within a batch. Every repetition times all calls, each time beginning with another one.
    """
    numbers = {}
    for name, call in calls.items():
        call()
        begin = time.process_time()
        call()
        numbers[name] = max(1, round(BATCH / max(time.process_time() - begin, 1e-7)))
    found: dict[str, list[float]] = {name: [] for name in calls}
    names = list(calls)
    for repetition in range(repeats):
        turn = repetition % len(names)
        for name in names[turn:] + names[:turn]:
            call, number = calls[name], numbers[name]
            begin = time.process_time()
            for _ in range(number):
                call()
            found[name].append(max(time.process_time() - begin, 1e-9) / number)
    return {name: tuple(each) for name, each in found.items()}


def timed(methods: Mapping[tuple[str, str], tuple[Callable[[], object], float]], repeats: int) -> tuple[Choice, ...]:
    """Return the choices of calls with known errors, by series and parameter."""
    seconds = interleaved({"|".join(key): call for key, (call, _) in methods.items()}, repeats)
    return tuple(Choice(*key, error, seconds["|".join(key)]) for key, (_, error) in methods.items())
