# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board on a bus: its numbers run from power-on, its scene from the first start command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import COMMAND_OFFSET, RESPONSE_OFFSET, Command, Request, Response
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.firmware import with_whole_period
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()
SCENE = load_scene("press_slide_lift", SENSOR)
MILLISECOND = 1_000_000


def board_of(sensor: Sensor, error_model: ErrorModel | None = None) -> SimulatedBoard:
    return SimulatedBoard(sensor, SceneLoads(SCENE, sensor), 3, error_model)


def command(node: BusBoard, what: Command, now: int, argument: int = 0) -> Response:
    """Send a command and return the response to it."""
    base = SENSOR.can.base_id
    frames = node.receive((base + COMMAND_OFFSET, CLASSIC, Request(what, 1, argument).pack()), now)
    (response,) = (Response.unpack(data) for identifier, _, data in frames if identifier == base + RESPONSE_OFFSET)
    assert response
    return response


def scans_of(frames: list[Frame], sensor: Sensor = SENSOR) -> list[Scan]:
    decoder = Decoder(sensor)
    decoder.start()
    return [found.scan.snapshot() for found in decoder.decode(frames, 0, 0) if hasattr(found, "scan")]


def run(node: BusBoard, until: int) -> list[Frame]:
    frames = []
    while (now := node.next_due()) <= until:
        frames += node.due(now)
    return frames


@pytest.mark.parametrize("drift", [0.0, 500e-6])
def test_the_sequence_goes_on_from_power_on_and_the_scene_begins_with_the_first_start(drift: float) -> None:
    begin = 7_000 * MILLISECOND
    node = BusBoard(board_of(SENSOR, replace(ErrorModel.none(), clock_drift=drift)), 3, begin)
    stamps: list[int] = []
    node.on_scan = lambda scan: stamps.append(scan.stamp)
    assert scans_of(run(node, begin + 1_499 * MILLISECOND)) == []
    start = begin + 1_500 * MILLISECOND + 300_000
    first = 1_501 if drift == 0.0 else 1_500
    assert command(node, Command.START, start).value == first
    scans = scans_of(run(node, start + 200 * MILLISECOND))
    assert [scan.sequence for scan in scans] == list(range(first, first + len(scans)))
    assert [scan.device_time for scan in scans] == [1000 * scan.sequence for scan in scans]
    assert len(scans) in {199, 200}
    assert stamps[0] == 0
    assert 0 <= node.scene_begin - start <= MILLISECOND
    reference, expected = board_of(SENSOR, replace(ErrorModel.none(), clock_drift=drift)), Scan.empty(1, 25)
    for index, scan in enumerate(scans):
        reference.scan(index, expected)
        np.testing.assert_array_equal(scan.counts, expected.counts)


def test_the_scene_does_not_begin_again_with_the_next_start() -> None:
    node = BusBoard(board_of(SENSOR), 3, 0)
    command(node, Command.START, 0)
    run(node, 100 * MILLISECOND + 1)
    begin = node.scene_begin
    assert command(node, Command.STOP, 100 * MILLISECOND + 2).value == 101
    assert command(node, Command.START, 150 * MILLISECOND - 1).value == 150
    scans = scans_of(run(node, 160 * MILLISECOND))
    assert [scan.sequence for scan in scans] == list(range(150, 160))
    assert node.scene_begin == begin == 0


def test_the_board_keeps_the_period_that_it_states() -> None:
    sensor = with_whole_period(replace(SENSOR, can=replace(SENSOR.can, scan_rate=300.0)))
    node = BusBoard(board_of(sensor), 3, 0)
    assert command(node, Command.SET_RATE, 0, 3333).value == 3333
    command(node, Command.START, 0)
    times: list[tuple[int, int, int]] = []
    now = 0
    node.on_scan = lambda scan: times.append((now, scan.stamp, scan.device_time))
    while len(times) < 1000:
        now = node.next_due()
        node.due(now)
    assert [device for _, _, device in times] == [3333 * index for index in range(1000)]
    assert [sampled for _, sampled, _ in times] == [3_333_000 * index for index in range(1000)]
    assert all(0 <= sent - sampled <= 2 for sent, sampled, _ in times)


def test_a_board_cannot_keep_a_period_of_fractions_of_a_microsecond() -> None:
    with pytest.raises(ValueError, match=r"scan period must be whole microseconds, got a rate of 300\.0 Hz"):
        BusBoard(board_of(replace(SENSOR, can=replace(SENSOR.can, scan_rate=300.0))), 3, 0)
