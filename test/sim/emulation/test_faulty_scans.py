# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Faults between board and receiver: probabilities, effects and reproducibility, for scans and for frames."""

import itertools
import threading
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.faults import Health
from posfet_driver.bus.frame import CLASSIC, FD
from posfet_driver.bus.open_bus import bus_settings, open_bus
from posfet_driver.protocol.messages import (
    CLASSIC_BLOCK_OFFSET,
    COMMAND_OFFSET,
    FD_BLOCK_OFFSET,
    RESPONSE_OFFSET,
    Command,
    Request,
)
from posfet_driver.protocol.scan_codec import FD_LENGTH
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.bus_peer import SimulatedBusPeer
from posfet_sim.emulation.faulty_scans import FaultyScans
from posfet_sim.emulation.link_faults import ResetSchedule
from posfet_sim.emulation.realtime_source import SimulationSource
from posfet_sim.scene import SceneLoads, load_scene
from support.clocks import PacedClock, SteppedClock

SENSOR = load_sensor()
SCENE = load_scene("idle", SENSOR)
NONE = ErrorModel.none()
FAULTY = replace(NONE, drop_probability=0.05, truncation_probability=0.03, duplication_probability=0.02)
RESETTING = replace(NONE, resets_per_hour=3600.0, reset_time=0.2)
START = (SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, Request(Command.START, tag=1).pack())
PERIOD = 1_000_000
PATIENCE = 120.0


def read(source: SimulationSource, scans: int) -> list[int]:
    sequences = []
    while len(sequences) < scans:
        scan = source.read(0.01)
        if scan is not None:
            sequences.append(scan.sequence)
    return sequences


def test_scans_are_lost_and_duplicated_with_the_requested_probabilities() -> None:
    source = SimulationSource(SENSOR, SCENE, 2, SteppedClock(5_000_000_000, 1_000), FAULTY)
    source.open()
    sequences = read(source, 10_000)
    seen = Counter(sequences)
    lost = 1 - len(seen) / (sequences[-1] + 1)
    assert sequences == sorted(sequences)
    assert max(seen.values()) == 2
    assert lost == pytest.approx(0.08, abs=0.01)
    assert sum(count == 2 for count in seen.values()) / (sequences[-1] + 1) == pytest.approx(0.02, abs=0.005)
    counters = source.report().counters
    assert counters["simulated: dropped"] + counters["simulated: truncated"] == sequences[-1] + 1 - len(seen)
    again = SimulationSource(SENSOR, SCENE, 2, SteppedClock(5_000_000_000, 1_000), FAULTY)
    again.open()
    assert read(again, 2000) == sequences[:2000]


def test_without_faults_every_scan_arrives_once() -> None:
    source = SimulationSource(SENSOR, SCENE, 2, SteppedClock(5_000_000_000, 1_000), NONE)
    source.open()
    assert read(source, 1000) == list(range(1000))


def test_a_reset_pauses_and_restarts_the_sequence() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(SCENE, SENSOR), 4, RESETTING)
    scans = FaultyScans(board, 4)
    scan = Scan.empty(1, SENSOR.layout.taxels)
    flagged, silent, before = 0, 0, -1
    for index in range(10_000):
        if not scans.scan(index, scan):
            silent += 1
            continue
        if scan.status & ScanStatus.BOARD_RESET:
            flagged += 1
            assert (scan.sequence, scan.device_time) == (0, 0)
        else:
            assert scan.sequence == before + 1
        before = scan.sequence
    assert 3 < flagged < 20  # 8 expected
    assert scans.counters["lost in resets"] == silent == pytest.approx(200 * flagged, abs=200)


def test_resets_do_not_depend_on_the_read_times() -> None:
    often, rarely = ResetSchedule(RESETTING, 7), ResetSchedule(RESETTING, 7)
    known = [often.running_since(time) for time in np.arange(0, 60, 0.01)]
    assert rarely.running_since(59.99) == known[-1]
    assert rarely.running_since(12.34) == known[1234]
    assert rarely.next_after(12.34) > 12.34


def frames_of_a_run(error_model: ErrorModel, seconds: float, fd: bool = True) -> list[tuple[int, int, bytes]]:
    sensor = replace(SENSOR, can=replace(SENSOR.can, fd=fd))
    node = BusBoard(SimulatedBoard(sensor, SceneLoads(SCENE, sensor), 1, error_model), 1, 0)
    frames = node.receive(START, 0)
    now = 0
    while now < seconds * 1e9:
        now = max(node.next_due(), now)
        frames += node.due(now)
        if not node.running:
            frames += node.receive(START, now)
    return frames


def test_the_link_without_faults_passes_the_firmware_frames_unchanged() -> None:
    frames = frames_of_a_run(NONE, 1.0)
    assert sum(bool(kind & FD) for _, kind, _ in frames) in {1000, 1001}


@pytest.mark.parametrize("fd", [True, False])
def test_frames_are_lost_truncated_and_duplicated(fd: bool) -> None:
    frames = frames_of_a_run(FAULTY, 5.0, fd)
    blocks = [frame for frame in frames if len(frame[2]) != 8 or not fd]
    blocks = [frame for frame in blocks if frame[0] - SENSOR.can.base_id in ({3} if fd else set(range(8, 13)))]
    sent = 5001 * (1 if fd else 5)
    short = sum(len(data) == (FD_LENGTH if fd else 8) // 2 for _, _, data in blocks)
    twice = sum(one == other for one, other in itertools.pairwise(blocks))
    assert short / sent == pytest.approx(0.03, abs=0.01)
    assert twice / sent == pytest.approx(0.02, abs=0.008)
    assert len(blocks) / sent == pytest.approx(1 - 0.05 + 0.02, abs=0.015)


def test_frames_carry_the_drift_of_the_board_clock() -> None:
    node = BusBoard(SimulatedBoard(SENSOR, SceneLoads(SCENE, SENSOR), 1, replace(NONE, clock_drift=500e-6)), 1, 0)
    node.receive(START, 0)
    stamps: list[int] = []
    node.on_scan = lambda scan: stamps.append(scan.stamp)
    now = 0
    while len(stamps) < 2001:
        now = node.next_due()
        node.due(now)
    assert stamps[-1] == 2_000_000_000 + 1_000_000
    assert now == pytest.approx(2_001_000_000, abs=10)


def test_the_board_waits_for_a_start_command_after_a_reset() -> None:
    frames = frames_of_a_run(RESETTING, 6.0)
    responses = [data for identifier, _, data in frames if identifier == SENSOR.can.base_id + RESPONSE_OFFSET]
    assert len(responses) > 2


@pytest.mark.parametrize("fd", [True, False])
def test_the_driver_never_publishes_a_corrupted_scan(fd: bool) -> None:
    sensor = replace(SENSOR, can=replace(SENSOR.can, fd=fd, scan_rate=200.0))
    faulty = replace(NONE, drop_probability=0.03, truncation_probability=0.03, duplication_probability=0.03)
    clock = PacedClock()
    settings = bus_settings("virtual", f"faulty-{threading.get_ident()}-{fd}", sensor.can)
    source = SimulatedBusPeer(sensor, load_scene("hold", sensor), 6, settings, clock, faulty)
    board = Board(sensor, lambda: open_bus(settings), clock)
    reference, expected = (
        SimulatedBoard(sensor, SceneLoads(load_scene("hold", sensor), sensor), 6),
        Scan.empty(1, sensor.layout.taxels),
    )
    lost = 0x0F if not fd else 0  # bits that classic frames do not carry
    indices: dict[int, int] = {}
    source.on_scan = lambda scan, stamp: indices.__setitem__(scan.sequence, source.board.index)
    source.open()
    board.open()
    try:
        seen, before = 0, -1
        while seen < 150:
            assert clock.monotonic() < PATIENCE * 1e9, board.report()
            scan = board.read(0.1)
            if scan is not None:
                assert scan.sequence > before
                reference.scan(indices[scan.sequence], expected)
                np.testing.assert_array_equal(scan.counts & ~np.uint16(lost), expected.counts & ~np.uint16(lost))
                seen, before = seen + 1, scan.sequence
        assert board.report().frames_lost > 0
        assert source.report().counters["simulated: truncated"] > 0
    finally:
        board.close()
        source.close()


@pytest.mark.parametrize("fd", [True, False])
def test_the_driver_reads_the_board_on_a_python_can_bus(fd: bool) -> None:
    channel = f"board-{threading.get_ident()}-{fd}"
    sensor = replace(SENSOR, can=replace(SENSOR.can, fd=fd))
    settings = bus_settings("virtual", channel, sensor.can)
    source = SimulatedBusPeer(sensor, load_scene("hold", sensor), 6, settings)
    sent: dict[int, np.ndarray] = {}
    source.on_scan = lambda scan, stamp: sent.__setitem__(source.board.index, scan.counts.copy())
    source.open()
    bus = open_bus(settings)
    try:
        assert "waiting on the bus virtual:" in source.report().state
        bus.write_frame(START)
        blocks, end = 0, threading.Event()
        timer = threading.Timer(PATIENCE, end.set)
        timer.start()
        while blocks < 200 and not end.is_set():
            offsets = [identifier - sensor.can.base_id for identifier, _, _ in bus.read_frames(0.1)]
            blocks += sum(offset == FD_BLOCK_OFFSET or offset >= CLASSIC_BLOCK_OFFSET for offset in offsets)
        timer.cancel()
        assert blocks >= 200
        assert source.report().health == Health.OK
        assert len(sent) >= 200 // (1 if fd else 5)
    finally:
        bus.shutdown()
        source.close()
    assert source.report().state == "simulation stopped"
    board, scan = (
        SimulatedBoard(sensor, SceneLoads(load_scene("hold", sensor), sensor), 6),
        Scan.empty(1, sensor.layout.taxels),
    )
    for index in sorted(sent):
        board.scan(index, scan)
        np.testing.assert_array_equal(sent[index], scan.counts)
