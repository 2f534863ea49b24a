"""The time of arrival from the kernel's stamps: never outside the read, and not across a step of the wall clock."""

from __future__ import annotations

import pytest

from posfet_driver.bus.arrival_time import OFFSET_TOLERANCE, ArrivalTime

MILLISECOND = 1_000_000
OFFSET = 1_700_000_000_000_000_000


@pytest.fixture
def arrival() -> ArrivalTime:
    """After a read at 100 ms."""
    arrival = ArrivalTime()
    assert arrival.of_newest(0, 100 * MILLISECOND, OFFSET) == 100 * MILLISECOND
    return arrival


@pytest.mark.parametrize(
    ("stamped", "expected"),
    [(103, 103), (110, 110), (99, 100), (-50_000, 100), (111, 110), (50_000, 110)],
    ids=["between", "now", "before the previous read", "long before", "after this read", "long after"],
)
def test_the_frame_arrived_between_the_reads(arrival: ArrivalTime, stamped: int, expected: int) -> None:
    found = arrival.of_newest(OFFSET + stamped * MILLISECOND, 110 * MILLISECOND, OFFSET)
    assert found == expected * MILLISECOND


def test_without_a_stamp_it_is_the_time_of_the_read(arrival: ArrivalTime) -> None:
    assert arrival.of_newest(0, 110 * MILLISECOND, OFFSET) == 110 * MILLISECOND


def test_the_first_read_has_no_offset_to_compare_with() -> None:
    assert ArrivalTime().of_newest(OFFSET + MILLISECOND, 2 * MILLISECOND, OFFSET) == 2 * MILLISECOND


@pytest.mark.parametrize("step", [-3_600_000_000_000, -2 * OFFSET_TOLERANCE, 2 * OFFSET_TOLERANCE, 3_600_000_000_000])
def test_a_wall_clock_that_is_set_between_arrival_and_read_does_not_matter(arrival: ArrivalTime, step: int) -> None:
    stamp = OFFSET + 103 * MILLISECOND
    assert arrival.of_newest(stamp, 110 * MILLISECOND, OFFSET + step) == 110 * MILLISECOND
    assert arrival.of_newest(stamp + step + 10 * MILLISECOND, 120 * MILLISECOND, OFFSET + step) == 113 * MILLISECOND


def test_a_delay_between_the_readings_of_the_clocks_never_makes_it_early(arrival: ArrivalTime) -> None:
    late = OFFSET + OFFSET_TOLERANCE // 2
    assert arrival.of_newest(OFFSET + 103 * MILLISECOND, 110 * MILLISECOND, late) == 103 * MILLISECOND
