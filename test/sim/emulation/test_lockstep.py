# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans one at a time, with the clock in the caller's loop."""

from dataclasses import replace

import numpy as np

from posfet_model.sensor.description import load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.lockstep import LockstepBoard
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()
SCENE = load_scene("press", SENSOR)


def test_the_scans_are_those_of_a_run_as_a_whole() -> None:
    board = LockstepBoard(SENSOR, SceneLoads(SCENE, SENSOR), 3, ErrorModel.default())
    count = 0
    for scan, truth in received_scans(SENSOR, SCENE, 0.5, 3, ErrorModel.default()):
        found = board.next_scan()
        assert found is not None
        assert (found.sequence, found.device_time) == (scan.sequence, scan.device_time)
        np.testing.assert_array_equal(found.counts, scan.counts)
        assert board.board.truth().time == truth.time
        count += 1
    assert count > 490


def test_a_scan_that_the_link_loses_is_none_and_a_reset_board_is_started_again() -> None:
    model = replace(ErrorModel.none(), drop_probability=0.2, resets_per_hour=3600.0, reset_time=0.05)
    board = LockstepBoard(SENSOR, SceneLoads(SCENE, SENSOR), 3, model)
    scans = [scan.sequence if (scan := board.next_scan()) else None for _ in range(3000)]
    assert 0.15 < scans.count(None) / len(scans) < 0.25
    restarts = sum(
        later < earlier
        for earlier, later in zip(
            *[[each for each in scans if each is not None][step:] for step in (0, 1)], strict=False
        )
    )
    assert restarts >= 1
