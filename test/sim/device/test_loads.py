# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board driven by custom loads, without a scene."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.loads import Loads, ObjectsState, Patch
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()
TAXELS = SENSOR.layout.taxels
NO_OBJECTS = ObjectsState(
    names=(),
    positions=np.zeros((0, 3)),
    orientations=np.zeros((0, 4)),
    contact_objects=np.zeros(0, np.intp),
    contact_centres=np.zeros((0, 2)),
    contact_normals=np.zeros((0, 3)),
    contact_forces=np.zeros(0),
)


class Ramp:
    """Two overlapping patches whose force grows by 1 N/s for 0.2 s and then stays; the chip warms by 10 K/s."""

    name = "ramp"
    live = False
    end = 0.2

    def forces(self, times: Sequence[float]) -> list[Patch]:
        force = np.minimum(np.array(times), self.end)[:, None, None]
        return [
            Patch(slice(1, 3), slice(1, 3), np.broadcast_to(force, (len(times), 2, 2))),
            Patch(slice(2, 4), slice(2, 3), np.broadcast_to(force, (len(times), 2, 1))),
        ]

    def temperatures(self, times: Sequence[float]) -> list[float]:
        return [25.0 + 10 * min(time, self.end) for time in times]

    def constant_until(self, time: float) -> float:
        return time if time < self.end else math.inf

    def objects(self, time: float) -> ObjectsState:
        return NO_OBJECTS


def test_the_board_simulates_custom_loads() -> None:
    loads: Loads = Ramp()
    board, every = SimulatedBoard(SENSOR, loads, 0), SimulatedBoard(SENSOR, loads, 0, compute_all=True)
    scan, other = Scan.empty(SENSOR.layout.id, TAXELS), Scan.empty(SENSOR.layout.id, TAXELS)
    expected = np.zeros((5, 5))
    expected[1:3, 1:3] += 1.0
    expected[2:4, 2:3] += 1.0
    for index in range(400):
        board.scan(index, scan)
        every.scan(index, other)
        np.testing.assert_array_equal(scan.counts, other.counts)
        truth = board.truth()
        np.testing.assert_allclose(truth.force.reshape(5, 5), expected * min(index * 1e-3, 0.2), rtol=0, atol=1e-12)
        assert truth.chip_temperature == pytest.approx(25.0 + 10 * min(index * 1e-3, 0.2))
    assert truth.objects is NO_OBJECTS
    assert board.in_contact


def test_scene_forces_replayed_as_custom_loads_give_the_same_scans() -> None:
    scene_loads = SceneLoads(load_scene("two_fingers", SENSOR), SENSOR)

    class Replay(Ramp):
        def forces(self, times: Sequence[float]) -> list[Patch]:
            whole = np.zeros((len(times), 5, 5))
            for patch in scene_loads.forces(times):
                whole[:, patch.rows, patch.cols] += patch.force
            return [Patch(slice(0, 5), slice(0, 5), whole)]

        def temperatures(self, times: Sequence[float]) -> list[float]:
            return list(scene_loads.temperatures(times))

        def constant_until(self, time: float) -> float:
            return time

    boards = [SimulatedBoard(SENSOR, loads, 3) for loads in (scene_loads, Replay())]
    scans = [Scan.empty(SENSOR.layout.id, TAXELS) for _ in boards]
    for index in range(1500):
        for board, scan in zip(boards, scans, strict=True):
            board.scan(index, scan)
        np.testing.assert_array_equal(scans[0].counts, scans[1].counts)


def test_live_loads_are_asked_for_no_time_before_its_scan_is_read() -> None:
    class Live(Ramp):
        live = True
        latest = 0.0

        def forces(self, times: Sequence[float]) -> list[Patch]:
            self.latest = max(self.latest, *times)
            return super().forces(times)

    loads = Live()
    board, known = SimulatedBoard(SENSOR, loads, 0), SimulatedBoard(SENSOR, Ramp(), 0)
    scan, other = Scan.empty(SENSOR.layout.id, TAXELS), Scan.empty(SENSOR.layout.id, TAXELS)
    for index in range(150):
        board.prepare(index)
        assert loads.latest <= max(index - 1, 0) * 1e-3
        board.scan(index, scan)
        known.scan(index, other)
        np.testing.assert_array_equal(scan.counts, other.counts)
        assert loads.latest == pytest.approx(index * 1e-3)
