"""The whole wire path: firmware, emulated adapter on a pseudo-terminal, slcan bus, board."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
from fake_board import FakeBoard, assert_marked, make_scan, read_scans, read_until, slcan_opener

from posfet_driver.adapter import EmulatedAdapter
from posfet_driver.board import Board
from posfet_driver.firmware import BoardFirmware
from posfet_driver.frames import CLASSIC, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame, frame_of, message_of
from posfet_driver.messages import COMMAND_OFFSET, RESPONSE_OFFSET, Command, Request, Response, Result
from posfet_driver.slcan import SlcanBus
from posfet_driver.source import Health, SourceError, SystemClock
from posfet_model.scan import ScanStatus
from posfet_model.sensor import Sensor

FRAMES: list[Frame] = [
    (0x123, CLASSIC, b"\x01\x02"),
    (0x000, CLASSIC, b""),
    (0x1234_5678, EXTENDED, bytes(range(8))),
    (0x7FF, REMOTE, bytes(5)),
    (0x1FFF_FFFF, EXTENDED | REMOTE, bytes(8)),
    (0x103, FD, bytes(range(48))),
    (0x103, FD | RATE_SWITCH, bytes(range(64))),
    (0x1ABC_DEF0, FD | EXTENDED, bytes(12)),
    (0x1ABC_DEF0, FD | RATE_SWITCH | EXTENDED, bytes(64)),
]


class Echo:
    """A node on the bus that sends back what it gets, and nothing else."""

    def next_due(self) -> int:
        return 1 << 62

    def due(self, now: int) -> list[Frame]:
        return []

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        return [frame]


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "can0"


@pytest.fixture
def echo(link: Path) -> Iterator[EmulatedAdapter]:
    adapter = EmulatedAdapter(link, Echo())
    adapter.open()
    yield adapter
    adapter.close()


def firmware_for(sensor: Sensor, fd: bool) -> BoardFirmware:
    return BoardFirmware(sensor, FakeBoard(sensor), SystemClock().monotonic(), fd)


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_scans_arrive_whole_in_order_and_none_is_lost(sensor: Sensor, link: Path, fd: bool) -> None:
    adapter = EmulatedAdapter(link, firmware_for(sensor, fd))
    adapter.open()
    board = Board(sensor, slcan_opener(link), fd)
    board.open()
    try:
        expected = None
        for scan in read_scans(board, 600):
            assert_marked(scan)
            if expected is None:
                assert scan.status & ScanStatus.BOARD_RESET
            else:
                assert scan.sequence == expected
                assert scan.status == (0 if fd else ScanStatus.TIME_ESTIMATED)
            expected = scan.sequence + 1
            assert scan.frames_lost == 0
            assert scan.device_time == (round(scan.sequence * 1e6 / sensor.can.scan_rate) if fd else 0)
        np.testing.assert_array_equal(board.receiver.scan.temperatures, [23.5, 23.5])
        report = board.report()
        assert report.health == Health.OK
        assert report.values["firmware"] == "0.1"
        assert not any(report.counters.values())
        assert adapter.frames_dropped == 0
    finally:
        board.close()
        adapter.close()
    assert not link.is_symlink()
