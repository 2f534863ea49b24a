# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contact tracking: nearest contact first, exact assignment, and the whole tracker's; moving contacts that meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import permutations

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.interleaved import interleaved
from benchmarks.outcome import shown
from posfet_core.scan_path import minimum_cost_assignment

CONTACTS = (2, 4, 6)
SCANS = 400
FIELD = 6.0
"""Width of the array [mm]."""

MOVE = 0.9
"""Standard deviation of a move from scan to scan [mm]; at 1 kHz the tracker sees a thousandth of that: this is what a
rate of some Hz, or lost scans, would ask of it."""

FAR = 1e6
"""Cost of no successor [mm2]: every contact has one."""

Costs = Sequence[Sequence[float]]
Pairs = dict[int, int]


def measure(effort: Effort) -> list[Front]:
    """Return the front of both ways, for several numbers of contacts."""
    return [_front(count, effort) for count in (CONTACTS[:1] if effort.short else CONTACTS)]


def in_order(costs: Costs) -> Pairs:
    """Assign each contact in turn to the nearest one that is left."""
    free, found = set(range(len(costs[0]))), {}
    for row, line in enumerate(costs):
        if free:
            found[row] = min(free, key=line.__getitem__)
            free.remove(found[row])
    return found


def nearest_first(costs: Costs) -> Pairs:
    """Assign the nearest pair first, then the nearest of the rest."""
    pairs = sorted((cost, row, column) for row, line in enumerate(costs) for column, cost in enumerate(line))
    found: Pairs = {}
    for _, row, column in pairs:
        if row not in found and column not in found.values():
            found[row] = column
    return found


def exhaustive(costs: Costs) -> Pairs:
    """Try every assignment."""
    size = len(costs)
    best = min(permutations(range(size)), key=lambda each: sum(costs[row][column] for row, column in enumerate(each)))
    return dict(enumerate(best))


def exact(costs: Costs) -> Pairs:
    """Return the assignment of least cost, as the tracker of this stack asks for it."""
    return dict(minimum_cost_assignment(costs, FAR))


METHODS: dict[str, Callable[[Costs], Pairs]] = {
    "in order, nearest": in_order,
    "nearest pair first": nearest_first,
    "exact assignment": exact,
    "all permutations": exhaustive,
}


def _front(count: int, effort: Effort) -> Front:
    random = np.random.default_rng(count)
    tables = []
    for _ in range(SCANS):
        before = random.uniform(0, FIELD, (count, 2))
        after = before + MOVE * random.standard_normal((count, 2))
        tables.append((((before[:, None] - after[None]) ** 2).sum(axis=2)).tolist())
    wrong, excess = {}, {}
    for name, method in METHODS.items():
        found = [method(costs) for costs in tables]
        wrong[name] = 100 * sum(row != column for each in found for row, column in each.items()) / (SCANS * count)
        excess[name] = sum(
            sum(costs[row][column] for row, column in each.items()) for costs, each in zip(tables, found, strict=True)
        )
    some = tables[:40]
    seconds = interleaved(
        {name: (lambda method=method: [method(costs) for costs in some]) for name, method in METHODS.items()},
        effort.repeats,
    )
    choices = tuple(
        Choice(name, "", wrong[name], tuple(each / len(some) for each in seconds[name])) for name in METHODS
    )
    own, greedy = (
        next(each for each in choices if each.series == name) for name in ("exact assignment", "in order, nearest")
    )
    checks = (
        Check("cost of the exact assignment over that of the best of all permutations [1]",
              excess["exact assignment"] / excess["all permutations"], 1 - 1e-12, 1 + 1e-12),
        Check("cost of the nearest in order over the least [1]",
              excess["in order, nearest"] / excess["all permutations"], 1.0, math.inf),
    )  # fmt: skip
    return Front(
        f"tracking_{count}",
        f"Contact tracking, {count} contacts",
        f"one scan with {count} contacts",
        "wrong identities [%]",
        "identities of points that move at random",
        0.0,
        choices,
        "exact assignment",
        checks,
        f"With {count} contacts that move by {MOVE} mm, exact assignment confuses {shown(own.error)} % of them, taking "
        f"each contact's nearest in order {shown(greedy.error)} %, in {shown(greedy.median / own.median)} of the run "
        "time. At 1 kHz contacts move far less, and the tracker skips the assignment where one contact stays near.",
        why_not={
            "all permutations": "It gives the same answer; with 6 contacts it already has 720 assignments to try.",
            "": "With so few contacts it is rarely wrong, and with more of them it is.",
        },
        question="the identities of several contacts" if count == CONTACTS[-1] else "",
        rival=greedy.name if count == CONTACTS[-1] else "",
        swept=False,
    )
