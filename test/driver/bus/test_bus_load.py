# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bus load from frames whose bits were counted by hand."""

from __future__ import annotations

import math

import pytest

from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame

SECOND = 1_000_000_000
BITRATE, DATA_BITRATE = 500_000, 2_000_000


def load(frames: list[Frame], seconds: float = 1.0) -> float:
    """Return the load of a period in which these frames came."""
    found = BusLoad(BITRATE, DATA_BITRATE)
    found.add([], 5 * SECOND)
    found.add(frames, round((5 + seconds) * SECOND))
    return found.load


@pytest.mark.parametrize(
    ("kind", "length", "nominal_bits", "data_bits"),
    [
        # Start to CRC may be stuffed, by 1 in 4 at most: half of that on average. 13 bits follow that never are.
        (CLASSIC, 0, 34 + 8 / 2 + 13, 0),
        (CLASSIC, 8, 98 + 24 / 2 + 13, 0),
        (EXTENDED, 8, 98 + 24 / 2 + 13 + 20, 0),
        (REMOTE, 8, 34 + 8 / 2 + 13, 0),  # requests 8 bytes, carries none
        (FD | RATE_SWITCH, 16, 17 + 4 / 2 + 13, 5 + 128 + 33 / 2 + 27),
        (FD | RATE_SWITCH, 64, 17 + 4 / 2 + 13, 5 + 512 + 129 / 2 + 32),
        (FD, 64, 17 + 4 / 2 + 13 + 5 + 512 + 129 / 2 + 32, 0),
        (ERROR, 8, 20, 0),
    ],
)
def test_a_frame_takes_its_bits_at_their_rates(kind: int, length: int, nominal_bits: float, data_bits: float) -> None:
    expected = 100 * (nominal_bits / BITRATE + data_bits / DATA_BITRATE)
    assert load([(0x123, kind, bytes(length))] * 100) == pytest.approx(expected)


def test_frames_of_all_kinds_add_up_over_the_whole_period() -> None:
    short: Frame = (1, CLASSIC, b"")
    long: Frame = (2, CLASSIC, bytes(8))
    both = 30 * 51 / BITRATE + 20 * 123 / BITRATE
    assert load([short] * 30 + [long] * 20) == pytest.approx(both)
    assert load([short] * 30 + [long] * 20, 4.0) == pytest.approx(both / 4)  # a reader that was held up


def test_a_full_bus_has_a_load_of_one() -> None:
    assert load([(1, CLASSIC, bytes(8))] * round(BITRATE / 123)) == pytest.approx(1.0, abs=1e-3)


def test_the_load_is_unknown_before_the_first_complete_period() -> None:
    found = BusLoad(BITRATE, DATA_BITRATE)
    assert math.isnan(found.load)
    found.add([(1, CLASSIC, bytes(8))] * 1000, 5 * SECOND)
    assert math.isnan(found.load)
    found.add([], 6 * SECOND - 1)
    assert math.isnan(found.load)
    found.add([], 6 * SECOND)
    assert found.load == 0.0  # the frames before the period do not count


def test_each_period_has_its_own_load() -> None:
    found = BusLoad(BITRATE, DATA_BITRATE)
    found.add([], SECOND)
    frames: list[Frame] = [(1, CLASSIC, bytes(8))] * 100
    loads = []
    for now in range(2 * SECOND, 8 * SECOND, SECOND // 4):
        found.add(frames, now)
        loads.append(found.load)
    assert loads[0] == pytest.approx(100 * 123 / BITRATE)
    assert loads[1:4] == [loads[0]] * 3
    assert loads[4:] == pytest.approx([4 * loads[0]] * (len(loads) - 4))
