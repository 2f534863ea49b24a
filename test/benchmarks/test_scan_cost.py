# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Regression test of the run time of a scan."""

from __future__ import annotations

import json

import pytest

from support.scan_cost import BASELINE, CASES, costs, player

ALLOWED_RATIO = 1.3
TRIES = 4
"""Number of measurements, as other load may disturb a whole one."""


def test_what_is_measured_is_the_work_of_a_scan() -> None:
    take = player(touched=False)
    assert [take(index) for index in range(50)] == [1] * 50


@pytest.mark.slow
def test_the_cost_of_a_scan_stays_within_the_baseline() -> None:
    """In units of a fixed workload, the minimum of many interleaved runs: only a heavy load of the machine matters.

    If a change is worth its cost, `python test/support/scan_cost.py --store` makes it the new baseline.
    """
    stored = json.loads(BASELINE.read_text(encoding="ascii"))
    least = dict.fromkeys(CASES, float("inf"))
    for _ in range(TRIES):
        least = {name: min(least[name], cost) for name, cost in costs().items()}
        if all(least[name] <= ALLOWED_RATIO * stored[name] for name in CASES):
            return
    ratios = {name: round(least[name] / stored[name], 2) for name in CASES}
    raise AssertionError(f"times the stored cost: {ratios}, at most {ALLOWED_RATIO}")
