# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Ticks between classic headers: late samples, other periods, jumps of the sequence."""

from __future__ import annotations

import pytest

from posfet_core.protocol import TickLine


def line(*headers: tuple[int, int], period: float = 1000.0) -> TickLine:
    """Return the line of a board with an announced period [us] and these sequences and times [us] of headers."""
    ticks = TickLine()
    ticks.restart(period)
    for sequence, time in headers:
        ticks.add(sequence, time, estimated=False)
    return ticks


def test_a_header_that_was_sampled_late_bends_no_tick() -> None:
    headers = [(16 * index, 16_000 * index) for index in range(20)]
    for late in range(1, 20):
        spoilt = [*headers[:late], (headers[late][0], headers[late][1] + 900), *headers[late + 1 :]]
        for count in range(late + 1, 21):
            ticks = line(*spoilt[:count])
            last = headers[count - 1][0]
            assert [ticks.time(last + scan) for scan in (1, 15)] == [1000 * (last + 1), 1000 * (last + 15)]


def test_two_late_headers_of_six_do_not_change_the_period() -> None:
    times = [0, 16_000, 32_700, 48_000, 64_400, 80_000]
    assert line(*((16 * index, time) for index, time in enumerate(times))).period == 1000.0


def test_a_first_header_that_was_late_is_replaced_by_the_next() -> None:
    first, second, third = [line(*[(0, 800), (16, 16_000), (32, 32_000)][:count]) for count in (1, 2, 3)]
    assert second.time(20) == 20_000
    assert (first.agreed, second.agreed, third.agreed) == (False, False, True)
    assert (first.lowered, second.lowered, third.lowered) == (False, True, False)


@pytest.mark.parametrize("period", [500, 1100, 4000])
def test_a_period_that_was_not_announced_is_measured_by_two_steps(period: int) -> None:
    assert line((0, 0), (16, 16 * period)).period == 1000.0
    ticks = line(*((16 * index, 16 * index * period) for index in range(3)))
    assert (ticks.period, ticks.time(40)) == (period, 40 * period)


def test_a_small_difference_of_the_period_is_measured_in_a_few_steps() -> None:
    ticks = line(*((16 * index, round(16 * index * 1001.5)) for index in range(4)))
    assert ticks.time(63) == pytest.approx(63 * 1001.5, abs=1)


@pytest.mark.parametrize("jump", [1, -1, 7, 300])
def test_a_sequence_that_jumps_changes_no_period_and_begins_another_line(jump: int) -> None:
    ticks = line((0, 0), (16, 16_000), (32 + jump, 32_000))
    assert (ticks.period, ticks.time(36 + jump)) == (1000.0, 36_000)
    ticks.add(48, 48_000, estimated=False)
    assert (ticks.period, ticks.time(50)) == (1000.0, 50_000)


def test_times_that_are_counted_on_measure_nothing() -> None:
    ticks = line((0, 0), (16, 16_000))
    ticks.add(32, 32_010, estimated=True)
    assert ticks.period == 1000.0


@pytest.mark.parametrize("announced", [True, False])
def test_a_contradiction_that_was_resolved_confirms_no_later_one(announced: bool) -> None:
    """A step that is mixed of two periods is as long as one of another change, long before."""
    if announced:  # 2 ms, without a word of it
        ticks = line((0, 0), (16, 16_000), (32, 48_000), (48, 80_000))
        assert ticks.period == 2000.0
        ticks.restart(3000.0)
        begin, period = 80_000 - 48 * 3000, 3000
    else:  # a header of a sequence that jumped
        ticks = line((0, 0), (16, 32_000), (32, 48_000))
        begin, period = 16_000, 1000
    for sequence in (64, 80):
        ticks.add(sequence, begin + sequence * period, estimated=False)
    assert ticks.period == period
    ticks.add(96, begin + 80 * period + 16 * 2000, estimated=False)
    assert (ticks.period, ticks.certain) == (period, False)
