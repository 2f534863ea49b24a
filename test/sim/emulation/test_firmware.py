# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The emulated firmware: the board side of the protocol."""

from __future__ import annotations

import math

import pytest

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.decoded import ScanReady, StatusReceived
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.emulation.backlog import AT_ONCE, first_due
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import with_fd

SENSOR = load_sensor()
SECOND = 1_000_000_000
MILLISECOND = 1_000_000
BOTH = pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])


class Counter:
    """A board that records the requested scan indices."""

    def __init__(self) -> None:
        self.indices: list[int] = []

    def scan(self, index: int, out: Scan) -> None:
        self.indices.append(index)
        out.stamp, out.device_time = index * 1_000_000, index * 1000


def start(firmware: BoardFirmware, now: int) -> None:
    request = Request(Command.START, 1, 0)
    assert firmware.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)


def stop(firmware: BoardFirmware, now: int) -> None:
    request = Request(Command.STOP, 2, 0)
    assert firmware.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), now)


def test_scan_numbers_follow_the_time_since_power_on_also_while_stopped() -> None:
    board = Counter()
    firmware = BoardFirmware(SENSOR, board, 0)
    firmware.due(5 * SECOND)
    assert board.indices == []
    start(firmware, 5 * SECOND)
    firmware.due(5 * SECOND + SECOND // 10)
    assert board.indices == list(range(5000, 5101))
    stop(firmware, 6 * SECOND)
    start(firmware, 7 * SECOND)
    firmware.due(7 * SECOND + SECOND // 100)
    assert board.indices[101:] == list(range(7000, 7011))


def received(decoder: Decoder, frames: list[Frame], now: int) -> tuple[list[tuple[int, int]], list[int]]:
    """Return sequence and status of the scans in a batch of frames, and the flags of the status frames."""
    scans: list[tuple[int, int]] = []
    flags: list[int] = []
    for found in decoder.decode(frames, now, 0):
        if isinstance(found, ScanReady):
            scans.append((found.scan.sequence, found.scan.status))
        elif isinstance(found, StatusReceived):
            flags.append(found.status.flags)
    return scans, flags


@BOTH
@pytest.mark.parametrize("stop", [60, 36_000])
def test_after_a_stop_of_the_emulation_whole_scans_are_missed_counted_and_flagged(fd: bool, stop: int) -> None:
    board = Counter()
    firmware, decoder = BoardFirmware(with_fd(SENSOR, fd), board, 0), Decoder(with_fd(SENSOR, fd))
    decoder.start()
    start(firmware, 0)
    for now in range(0, SECOND, MILLISECOND):
        received(decoder, firmware.due(now), now)
    back = (1 + stop) * SECOND
    assert firmware.next_due() == SECOND
    scans, flags = received(decoder, first_due(firmware, back), back)
    assert board.indices[1000:] == [1000 * (1 + stop)]
    assert firmware.missed == 1000 * stop
    assert flags == [ScanStatus.SCAN_OVERRUN]
    assert firmware.next_due() == back + MILLISECOND
    for now in range(back + MILLISECOND, back + SECOND, MILLISECOND):
        more, flags = received(decoder, first_due(firmware, now), now)
        scans += more
        assert not any(flags)
    sequences = [sequence for sequence, _ in scans]
    assert sequences == list(range(1000 * (1 + stop) + 1000 - len(scans), 1000 * (1 + stop) + 1000))
    assert len(scans) > 980  # classic ones wait for a header
    if fd:
        assert [status for _, status in scans] == [ScanStatus.SCAN_OVERRUN] + [0] * 999
    assert decoder.statistics.lost_scans == 1000 * (1 + stop) - 1000 + 1000 - len(scans)


@BOTH
def test_a_short_delay_of_the_emulation_loses_no_scan_and_flags_those_that_are_late(fd: bool) -> None:
    board = Counter()
    firmware, decoder = BoardFirmware(with_fd(SENSOR, fd), board, 0), Decoder(with_fd(SENSOR, fd))
    decoder.start()
    start(firmware, 0)
    received(decoder, firmware.due(0), 0)
    now, parts, scans, flags = 400 * MILLISECOND, 0, [], []
    at_once = round(AT_ONCE * SECOND / MILLISECOND) + 1
    while firmware.next_due() <= now:
        more, states = received(decoder, first_due(firmware, now), now)
        scans, flags, parts = scans + more, flags + states, parts + 1
        assert len(more) <= at_once + (0 if fd else 32)  # a command is looked for between two parts
    assert board.indices == list(range(401))
    assert (firmware.missed, decoder.statistics.lost_scans) == (0, 0)
    assert parts == math.ceil(401 / at_once)
    assert flags == [ScanStatus.SCAN_OVERRUN] * 3 + [0]
    if fd:
        assert [bool(status) for _, status in scans] == [sequence < 300 for sequence, _ in scans]


def test_an_overrun_of_the_emulation_is_no_finding_of_the_self_test() -> None:
    firmware = BoardFirmware(SENSOR, Counter(), 0)
    start(firmware, 0)
    firmware.due(10 * SECOND)
    stop(firmware, 10 * SECOND)
    request = Request(Command.SELF_TEST, 3, 0)
    [frame] = firmware.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), 10 * SECOND)
    assert frame[2][2:4] == bytes(2)


def test_a_new_scan_period_counts_the_ticks_that_a_late_emulation_has_not_sent() -> None:
    board = Counter()
    firmware = BoardFirmware(SENSOR, board, 0)
    start(firmware, 0)
    firmware.due(0)
    request = Request(Command.SET_RATE, 2, 2000)
    firmware.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()), 300 * MILLISECOND)
    firmware.due(310 * MILLISECOND)
    assert board.indices[:3] == [0, 301, 303]
    assert firmware.missed == 299
