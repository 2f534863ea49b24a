# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Why a board does not respond, from what else is on the bus; and when the bus is opened again."""

from __future__ import annotations

import pytest

from posfet_driver.board.faults import FaultKind
from posfet_driver.board.no_response import REOPEN_FIRST, REOPEN_LAST, NoResponseMonitor
from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.protocol.decoded import Traffic

SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("own", "unrelated", "bit_errors", "other_errors", "cause"),
    [
        (0, 0, 0, 0, FaultKind.NO_TRAFFIC),
        (0, 0, 3, 0, FaultKind.BUS_ERRORS),
        (0, 0, 0, 3, FaultKind.NO_TRAFFIC),  # such as a frame that no one acknowledged
        (0, 4, 0, 0, FaultKind.BOARD_NOT_DETECTED),
        (0, 4, 9, 9, FaultKind.BOARD_NOT_DETECTED),
        (1, 4, 9, 9, FaultKind.NOT_RESPONDING),
        (1, 0, 0, 0, FaultKind.NOT_RESPONDING),
    ],
)
@pytest.mark.parametrize("before", [0, 1000])
def test_the_cause_fits_the_traffic_since_the_command(
    own: int, unrelated: int, bit_errors: int, other_errors: int, cause: FaultKind, before: int
) -> None:
    traffic, errors = Traffic(), ErrorCounts()
    monitor = NoResponseMonitor(traffic, errors)
    # What was on the bus before does not count.
    traffic.frames, traffic.unrelated = 5 * before, before
    errors.frames, errors.bit_errors = 3 * before, before
    monitor.begin(SECOND)
    # The decoder counts error frames as frames, too.
    traffic.frames += own + unrelated + bit_errors + other_errors
    traffic.unrelated += unrelated
    errors.frames += bit_errors + other_errors
    errors.bit_errors += bit_errors
    assert monitor.cause() is cause


def reopened(monitor: NoResponseMonitor, begin: int, seconds: float) -> list[float]:
    """Return after how many seconds the bus was opened again each time, looked at every 0.1 s."""
    found = []
    monitor.begin(begin)
    since = begin
    for now in range(begin, begin + round(seconds * SECOND), SECOND // 10):
        if monitor.reopen_due(now):
            found.append((now - since) / SECOND)
            since = now
            monitor.begin(now)
    return found


def test_the_bus_is_opened_again_less_and_less_often_until_the_board_responds() -> None:
    monitor = NoResponseMonitor(Traffic(), ErrorCounts())
    expected = [REOPEN_FIRST, 2 * REOPEN_FIRST, 4 * REOPEN_FIRST, REOPEN_LAST, REOPEN_LAST]
    assert reopened(monitor, 7 * SECOND, 18.0) == expected
    assert reopened(monitor, 99 * SECOND, 11.0) == [REOPEN_LAST, REOPEN_LAST]
    monitor.board_responded()
    assert reopened(monitor, 200 * SECOND, 4.0) == expected[:2]


def test_a_new_command_starts_the_time_but_not_the_doubling() -> None:
    monitor = NoResponseMonitor(Traffic(), ErrorCounts())
    monitor.begin(0)
    assert monitor.reopen_due(SECOND)
    monitor.begin(SECOND)
    assert not monitor.reopen_due(3 * SECOND - 1)
    monitor.begin(2 * SECOND)
    assert not monitor.reopen_due(4 * SECOND - 1)
    assert monitor.reopen_due(4 * SECOND)
