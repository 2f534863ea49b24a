# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The work of a scan, counted, so that it does not grow unnoticed."""

from __future__ import annotations

import json

import pytest

from support.scan_cost import BASELINE, CASES, cost, costs, player

ALLOWED_RATIO = 1.3


def test_what_is_measured_is_the_work_of_a_scan() -> None:
    take = player(touched=False)
    assert [take(index) for index in range(50)] == [1] * 50


def test_more_work_counts_as_more() -> None:
    take = player(touched=False)

    def longer(index: int) -> int:
        scans = take(index)
        for _ in range(50):
            abs(scans)
        return scans

    assert cost(longer) - cost(player(touched=False)) == pytest.approx(153, abs=5)


def test_the_cost_of_a_scan_stays_within_the_baseline() -> None:
    """If a change is worth its cost, `cd test && python -m support.scan_cost --store` makes it the new baseline."""
    stored, found = json.loads(BASELINE.read_text(encoding="ascii")), costs()
    ratios = {name: round(found[name] / stored[name], 2) for name in CASES}
    assert max(ratios.values()) <= ALLOWED_RATIO, ratios
