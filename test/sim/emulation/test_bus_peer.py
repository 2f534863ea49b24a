# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board behind its adapter: scans and report while a client reads the terminal."""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from posfet_driver.board.faults import Health
from posfet_driver.board.scan_source import ManagedDevice, ScanSource, SourceError
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.open_bus import bus_settings, open_bus
from posfet_driver.bus.slcan_codec import LineReader, encode_line
from posfet_driver.clock import SystemClock
from posfet_driver.protocol.messages import COMMAND_OFFSET, FD_BLOCK_OFFSET, STATUS_OFFSET, Command, Request
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.bus_peer import SimulatedBusPeer
from posfet_sim.scene import SceneLoads, load_scene
from support.clocks import PacedClock
from support.fake_board import PATIENCE
from support.fake_socketcan import FakeSocketcan

SENSOR = load_sensor()
SCENE = load_scene("press_slide_lift", SENSOR)
START = encode_line((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, Request(Command.START, tag=1).pack()))


@pytest.fixture
def source(tmp_path: Path) -> Iterator[SimulatedBusPeer]:
    source = SimulatedBusPeer(SENSOR, SCENE, 4, tmp_path / "board")
    yield source
    source.close()


def read_scans(link: Path, count: int) -> int:
    """Start the scans as a driver does and read `count` FD blocks from the terminal."""
    reader, blocks = LineReader(), 0
    with link.open("r+b", buffering=0) as terminal:
        terminal.write(b"O\r" + START)
        while blocks < count:
            frames = reader.frames(terminal.read(4096))
            blocks += sum(identifier == SENSOR.can.base_id + FD_BLOCK_OFFSET for identifier, _, _ in frames)
    return blocks


def test_sent_scans_equal_those_of_the_board(source: SimulatedBusPeer, tmp_path: Path) -> None:
    sent: list[tuple[int, int, int, np.ndarray]] = []
    source.on_scan = lambda scan, stamp: sent.append((source.board.index, scan.sequence, stamp, scan.counts.copy()))
    source.open()
    read_scans(tmp_path / "board", 100)
    source.close()
    board, scan = SimulatedBoard(SENSOR, SceneLoads(SCENE, SENSOR), 4), Scan.empty(1, SENSOR.layout.taxels)
    _, first_sequence, first_stamp, _ = sent[0]
    for index, sequence, stamp, counts in sent[:100]:
        board.scan(index, scan)
        np.testing.assert_array_equal(counts, scan.counts)
        assert sequence - first_sequence == index
        assert stamp - first_stamp == index * 1_000_000


def test_the_report_gives_the_current_state(source: SimulatedBusPeer, tmp_path: Path) -> None:
    assert source.report().health == Health.STALE
    source.open()
    assert "waiting on the adapter" in source.report().state
    blocks = read_scans(tmp_path / "board", 20)
    report = source.report()
    assert report.state == f"simulating scene 'press_slide_lift' on the adapter {tmp_path / 'board'}"
    assert report.scans >= blocks
    source.close()
    source.close()
    assert source.report().health == Health.STALE
    assert not (tmp_path / "board").is_symlink()
    source.open()
    assert source.report().scans >= blocks


def test_an_error_of_the_emulation_is_reported_and_gone_after_reopening(
    source: SimulatedBusPeer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = threading.Event()

    def fail(board: BusBoard, now: int, until: int | None = None) -> list[Frame]:
        ended.set()
        raise ValueError("odd\ntime")

    with monkeypatch.context() as patch:
        patch.setattr(BusBoard, "due", fail)
        source.open()
        assert ended.wait(120.0)
        for thread in [thread for thread in threading.enumerate() if thread.name == "slcan adapter"]:
            thread.join()
    report = source.report()
    assert (report.health, report.failure) == (Health.ERROR, "ValueError: odd time")
    assert report.state == f"simulated board on the adapter {tmp_path / 'board'} has ended: ValueError: odd time"
    source.close()
    source.open()
    assert (source.report().health, source.report().failure) == (Health.OK, "")
    assert read_scans(tmp_path / "board", 5)


def test_the_peer_is_not_a_source_of_scans(source: SimulatedBusPeer) -> None:
    device: ManagedDevice = source
    assert not isinstance(device, ScanSource)


def test_an_existing_file_at_the_link_path_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "board").touch()
    source = SimulatedBusPeer(SENSOR, SCENE, 0, tmp_path / "board")
    with pytest.raises(SourceError, match="cannot be linked here"):
        source.open()
    assert source.report().health == Health.STALE


def test_a_board_outlives_its_interface_going_down_and_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kernel = FakeSocketcan(monkeypatch, tmp_path / "net")
    device = kernel.add("can0")
    settings = bus_settings("socketcan", "can0", SENSOR.can)
    peer = SimulatedBusPeer(SENSOR, SCENE, 4, settings, PacedClock(main=False))
    peer.open()
    end = SystemClock().monotonic() + PATIENCE * 1e9
    for _ in range(2):
        anyone = open_bus(settings)
        statuses: list[Frame] = []
        while not statuses:
            assert SystemClock().monotonic() < end, peer.report()
            frames = anyone.read_frames(PATIENCE)
            statuses += [frame for frame in frames if frame[0] == SENSOR.can.base_id + STATUS_OFFSET]
        anyone.shutdown()
        assert peer.report().health == Health.OK
        device.switch(False)
        device.switch(True)
    peer.close()
    kernel.close()
