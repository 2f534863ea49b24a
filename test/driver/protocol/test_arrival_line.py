# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Losses without trace, told from delays by the arrival of scans."""

from __future__ import annotations

from reference.protocol.mapped.arrival_line import ArrivalLine

PERIOD = 1_000_000


def lost(arrivals: list[tuple[int, int]], span: float = PERIOD) -> int:
    """Return how many spans are missing in batches of (arrival, scans)."""
    line, missing = ArrivalLine(PERIOD), 0
    for arrival, scans in arrivals:
        line.begin_batch(arrival, scans)
        if not line.time:
            line.restart()
        for _ in range(scans):
            line.advance(1)
            missing += line.missing(span)
    return missing


def steady(begin: int, count: int, per_batch: int = 1) -> list[tuple[int, int]]:
    return [(1000 * PERIOD + index * PERIOD, per_batch) for index in range(begin, begin + count, per_batch)]


def test_nothing_is_missing_in_a_steady_stream() -> None:
    assert lost(steady(0, 1000)) == 0
    assert lost(steady(0, 1000, per_batch=10)) == 0
    assert lost(steady(0, 4000, per_batch=160)) == 0


def test_a_board_that_is_a_little_slow_or_fast_loses_nothing() -> None:
    for rate in (0.996, 1.004):
        assert lost([(round(arrival * rate), scans) for arrival, scans in steady(0, 3000)]) == 0


def test_a_lost_scan_is_noticed_within_two_windows() -> None:
    assert lost(steady(0, 100) + steady(101, 70)) == 1
    assert lost(steady(0, 100) + steady(103, 70)) == 3


def test_delays_are_no_losses() -> None:
    late = [
        (arrival + (200 * PERIOD if index == 50 else 0), scans) for index, (arrival, scans) in enumerate(steady(0, 51))
    ]
    assert lost([*late, *[(late[-1][0] + index, 1) for index in range(200)], *steady(251, 300)]) == 0


def test_a_long_pause_is_noticed_at_once() -> None:
    assert lost([*steady(0, 10), *steady(1010, 1)]) == 1000
    assert lost([*steady(0, 10), *steady(1010, 1)], span=256 * PERIOD) == 4


def test_a_long_delay_with_all_frames_is_no_loss() -> None:
    assert lost([*steady(0, 10), (1509 * PERIOD, 500), *steady(510, 50)]) == 0
