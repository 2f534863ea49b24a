# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scenes, error models and rig readings that nobody meant: each is read, or refused in one line; what is read runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.calibration.bench_recording import COLUMNS, read_reference
from posfet_sim.device.error_model import BOARD_KEYS, FILM_KEYS, KEYS, load_error_model
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene
from posfet_sim.scene.scene_file import SCENE_FOLDER
from support.fuzzing import COUNTS, assert_one_line, examples, mutated

SENSOR = load_sensor()


@pytest.mark.parametrize("count", COUNTS)
def test_any_scene_is_loaded_or_refused_and_runs(tmp_path: Path, count: int) -> None:
    path = tmp_path / "scene.yaml"
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)

    @examples(count)
    @given(mutated(*(shipped.read_bytes() for shipped in sorted(SCENE_FOLDER.glob("*.yaml")))))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            scene = load_scene(path, SENSOR)
        except ConfigError as error:
            assert_one_line(error, path)
            return
        board = SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0)
        for index in (0, 1, 700):
            board.scan(index, scan)
        assert board.truth().force.shape == (SENSOR.layout.taxels,)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_error_model_is_loaded_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "model.yaml"
    keys = (*KEYS, *FILM_KEYS, *BOARD_KEYS)
    text = "base: default\nrealism: hard\n"
    for title in dict.fromkeys(key.section for key in keys):
        text += f"{title}:\n" + "".join(f"  {key.name}: {key.low}\n" for key in keys if key.section == title)

    @examples(count)
    @given(mutated(text.encode()))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            load_error_model(str(path))
        except ConfigError as error:
            assert_one_line(error, path)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_rig_file_is_read_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "rig.csv"

    @examples(count)
    @given(mutated(",".join(COLUMNS).encode() + b"\n0,0,0,0\n1,1.5,-2,0.1\n2,1,1,2\n"))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            assert len(read_reference(path).times) >= 2
        except ConfigError as error:
            assert_one_line(error, path)

    check()
