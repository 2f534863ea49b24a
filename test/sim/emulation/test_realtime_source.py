# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board in real time, on a test clock."""

from dataclasses import replace

import numpy as np
import pytest

from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import ScanSource
from posfet_driver.clock import Clock
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.error_model import ErrorModel, load_error_model
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.backlog import LATE
from posfet_sim.emulation.realtime_source import SimulationSource
from posfet_sim.scene import SceneLoads, load_scene
from support.clocks import SteppedClock

SENSOR = load_sensor()
SCENE = load_scene("press_slide_lift", SENSOR)
EPOCH = 1_700_000_000_000_000_000
MILLISECOND = 1_000_000
REAL_FILM = replace(ErrorModel.none(), film=load_error_model("moderate").film)


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock(123_456_789, EPOCH)


def opened(clock: Clock, sensor=SENSOR, error_model=None) -> SimulationSource:
    source = SimulationSource(sensor, SCENE, 3, clock, error_model)
    as_source: ScanSource = source
    as_source.open()
    return source


def read(source: SimulationSource, timeout: float = 0.1) -> Scan:
    scan = source.read(timeout)
    assert scan is not None
    return scan


def test_scans_arrive_at_their_rate_with_stamps_from_the_start(clock: SteppedClock) -> None:
    source = opened(clock)
    start = clock.now
    for index in range(50):
        scan = read(source)
        assert clock.now == start + index * MILLISECOND
        assert scan.sequence == index
        assert scan.stamp == EPOCH + start + index * MILLISECOND
    assert clock.sleeps == [0.001] * 49


def test_a_late_reader_gets_every_due_scan_in_order(clock: SteppedClock) -> None:
    source = opened(clock)
    read(source)
    clock.now += 20 * MILLISECOND
    start = clock.now
    assert [read(source).sequence for _ in range(20)] == list(range(1, 21))
    assert clock.now == start
    assert read(source).sequence == 21
    assert clock.now == start + MILLISECOND


def test_scans_that_are_late_say_so(clock: SteppedClock) -> None:
    source = opened(clock)
    read(source)
    clock.now += 400 * MILLISECOND
    late = [read(source).status == ScanStatus.SCAN_OVERRUN for _ in range(400)]
    assert late == [True] * 299 + [False] * 101
    clock.now += 400 * MILLISECOND
    read(source)
    assert source.report().conditions == (FaultKind.SCAN_OVERRUN,)
    assert source.report().fault_counts == {FaultKind.SCAN_OVERRUN: 0}


@pytest.mark.parametrize("stop", [60, 36_000])
@pytest.mark.parametrize("error_model", [None, REAL_FILM], ids=["ideal", "real film"])
def test_after_a_stop_the_newest_scan_comes_at_once(
    clock: SteppedClock, error_model: ErrorModel | None, stop: int
) -> None:
    source = opened(clock, error_model=error_model)
    for _ in range(100):
        read(source)
    clock.now += stop * 1000 * MILLISECOND
    resumed, updates = clock.wall(), source.board.taxel_updates
    scan = read(source)
    assert 0 <= resumed - scan.stamp <= 2 * MILLISECOND
    assert scan.status == ScanStatus.SCAN_OVERRUN
    assert source.report().fault_counts == {FaultKind.SCAN_OVERRUN: scan.sequence - 100}
    assert (source.report().health, source.report().conditions) == (Health.OK, ())
    assert source.board.taxel_updates - updates <= 100 * SENSOR.layout.taxels
    sequence = scan.sequence
    assert [read(source).sequence for _ in range(1000)] == list(range(sequence + 1, sequence + 1001))
    assert clock.wall() - resumed <= 1002 * MILLISECOND


def test_what_a_press_has_left_behind_is_the_same_after_a_long_stop(clock: SteppedClock) -> None:
    source = opened(clock, error_model=REAL_FILM)
    board = SimulatedBoard(SENSOR, SceneLoads(SCENE, SENSOR), 3, REAL_FILM)
    expected = Scan.empty(1, SENSOR.layout.taxels)
    for index in range(1500):
        board.scan(index, expected)
        read(source)
    clock.now += 10_000 * MILLISECOND
    scan = read(source)
    board.scan(scan.sequence, expected)
    np.testing.assert_allclose(scan.counts.astype(float), expected.counts, atol=40.0)
    assert np.ptp(source.board.truth().force - board.truth().force) < 1e-12


def test_nothing_is_due_within_a_short_timeout(clock: SteppedClock) -> None:
    slow = replace(SENSOR, can=replace(SENSOR.can, scan_rate=2.0))
    source = opened(clock, slow)
    assert read(source).sequence == 0
    assert [source.read(0.1) for _ in range(4)] == [None] * 4
    assert read(source, 0.15).sequence == 1
    assert clock.sleeps == pytest.approx([0.1] * 5, abs=1e-9)


def test_scans_equal_those_of_the_board(clock: SteppedClock) -> None:
    source, board, expected = (
        opened(clock),
        SimulatedBoard(SENSOR, SceneLoads(SCENE, SENSOR), 3),
        Scan.empty(1, SENSOR.layout.taxels),
    )
    for index in range(600):
        board.scan(index, expected)
        np.testing.assert_array_equal(read(source).counts, expected.counts)
    assert source.board.truth().objects.contact_forces.tolist() == board.truth().objects.contact_forces.tolist()


def test_reopening_restarts_the_scene(clock: SteppedClock) -> None:
    source = opened(clock)
    first = read(source).counts.copy()
    for _ in range(5):
        read(source)
    source.close()
    clock.now += 5_000 * MILLISECOND
    source.open()
    scan = read(source)
    assert scan.sequence == 0
    assert scan.stamp == clock.wall()
    np.testing.assert_array_equal(scan.counts, first)


def test_the_report_gives_the_current_state(clock: SteppedClock) -> None:
    source = SimulationSource(SENSOR, SCENE, 3, clock)
    assert source.report().health == Health.STALE
    source.open()
    for _ in range(10):
        read(source)
    report = source.report()
    assert (report.health, report.scans, report.frames_lost) == (Health.OK, 10, 0)
    assert "press_slide_lift" in report.state
    clock.now += round(2 * LATE * 1e9)
    read(source)
    assert source.report().health == Health.WARN
    assert source.simulated
    source.close()
    source.close()
    assert source.report().health == Health.STALE
    assert source.report().scans == 11
