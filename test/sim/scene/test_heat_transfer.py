# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Heat transfer from warm objects: verified against the exponential of a held touch and a fine integration."""

import math
from pathlib import Path

import numpy as np
import pytest

from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_sim.scene import SCENE_FOLDER, Scene, SceneLoads, load_scene
from posfet_sim.scene.heat_transfer import CHIP_THICKNESS, LOSS_TIME_CONSTANT, SILICON_HEAT, SKIN_CONDUCTIVITY

SENSOR = load_sensor()
CAPACITY = 7.5e-3**2 * CHIP_THICKNESS * SILICON_HEAT
THICKNESS = 0.6e-3 / 0.7


def warm(folder: Path, temperature: str, name: str = "hold", period: str = "") -> Scene:
    text = (SCENE_FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    text = text.replace("    kind:", f"    temperature_degC: {temperature}\n    kind:")
    lines = [line for line in text.splitlines() if not line.startswith("period_s")]
    path = folder / "warm.yaml"
    path.write_text("\n".join([*lines, period]), encoding="utf-8")
    return load_scene(path, SENSOR)


def conductance(force: float) -> float:
    area = math.pi * (3 * force * 5e-3 / (4 * 2e6)) ** (2 / 3)  # Hertz
    return SKIN_CONDUCTIVITY / THICKNESS * area


def test_a_held_touch_warms_the_chip_exponentially(tmp_path: Path) -> None:
    scene = warm(tmp_path, "35.0")
    loss = CAPACITY / LOSS_TIME_CONSTANT
    goal = 10 * conductance(2.0) / (conductance(2.0) + loss)
    rate = (conductance(2.0) + loss) / CAPACITY
    begin = scene.chip_temperature(1.5) - 25
    assert scene.chip_temperature(1.0) == 25.0
    assert 0 < begin < goal
    for time in (2.0, 7.3, 30.0):
        expected = 25 + goal + (begin - goal) * math.exp(-rate * (time - 1.5))
        assert scene.chip_temperature(time) == pytest.approx(expected, abs=1e-5)
    assert 1 < goal < 5


def test_warming_agrees_with_a_fine_integration(tmp_path: Path) -> None:
    scene = warm(tmp_path, "10.0", "press_slide_lift", "period_s: 4.0")
    loss, step = CAPACITY / LOSS_TIME_CONSTANT, 1e-3
    gains = []
    for time in np.arange(0.5 * step, 4, step).tolist():
        force = scene.objects[0].path.at(time)[-1]
        gains.append(conductance(force) if force > 0 else 0.0)
    warmth = 0.0
    for _ in range(30):  # periods, until it repeats
        trace = [warmth]
        for gain in gains:
            warmth += step * (gain * (10 - 25 - warmth) - loss * warmth) / CAPACITY
            trace.append(warmth)
    for index in (0, 900, 2500, 3999):
        assert scene.chip_temperature(index * step) == pytest.approx(25 + trace[index], abs=2e-3)
    assert scene.chip_temperature(0.7) == scene.chip_temperature(4.7)
    assert min(trace) < -1


def test_the_temperature_is_exactly_constant_while_a_scene_rests(tmp_path: Path) -> None:
    loads = SceneLoads(warm(tmp_path, "30.0", "press"), SENSOR)
    rests = 0
    for time in np.arange(0.0, 150.0, 0.0931).tolist():
        until = loads.constant_until(time)
        for later in np.linspace(time, min(until, time + 5), 4, endpoint=False).tolist():
            assert loads.temperatures([later]) == loads.temperatures([time])
        rests += until > time
    assert rests > 100
    assert loads.constant_until(150.0) == math.inf
    assert loads.temperatures([150.0])[0] == pytest.approx(25.0, abs=1e-3)


def test_objects_without_a_temperature_do_not_warm_the_chip() -> None:
    scene = load_scene("press", SENSOR)
    assert scene.temperature_rise is None
    assert scene.chip_temperature(0.7) == 25.0


def test_a_temperature_out_of_range_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"objects\[0\].temperature_degC: must be a number in \[-40, 100\], got 200"):
        warm(tmp_path, "200")
