# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Random valid scenes load and run, and their ground truth and CSV rows are consistent."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.ground_truth import truth_columns, truth_row
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
PERIOD = 0.5


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda value: float(f"{value:.4g}"))


MODULUS = {"effective_modulus_MPa": number(0.5, 50)}
KINDS = st.one_of(
    st.fixed_dictionaries({"kind": st.just("sphere"), "radius_mm": number(1, 50), **MODULUS}),
    st.fixed_dictionaries({"kind": st.just("punch"), "radius_mm": number(0.2, 4), **MODULUS}),
    st.fixed_dictionaries(
        {"kind": st.just("cylinder"), "radius_mm": number(1, 5), "length_mm": number(4, 9), **MODULUS}
    ),
    st.fixed_dictionaries(
        {"kind": st.just("edge"), "flank_angle_deg": number(10, 60), "length_mm": number(4, 9), **MODULUS}
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("texture"),
            "profile": st.just("ridges"),
            "length_mm": number(1, 9),
            "width_mm": number(1, 9),
            "ridges": st.integers(1, 12),
            "amplitude_um": number(0, 50),
            **MODULUS,
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("texture"),
            "profile": st.just("bumps"),
            "length_mm": number(1, 9),
            "width_mm": number(1, 9),
            "bumps": st.integers(1, 60),
            "seed": st.integers(0, 99),
        }
    ),
    st.fixed_dictionaries({"kind": st.just("pad"), "length_mm": number(1, 9), "width_mm": number(1, 9)}),
    st.fixed_dictionaries(
        {"kind": st.just("ring"), "outer_radius_mm": number(2, 4), "inner_radius_mm": number(0.2, 1.9)}
    ),
    st.fixed_dictionaries(
        {"kind": st.just("screw_head"), "radius_mm": number(1, 4), "slot_width_mm": number(0.1, 1.9)}
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("ridged_fingertip"),
            "radius_mm": number(1, 50),
            "ridge_spacing_mm": number(0.3, 5),
            "ridge_contrast_percent": number(0, 100),
            **MODULUS,
        }
    ),
)
PLACE = {"x_mm": number(-2, 2), "y_mm": number(-2, 2), "angle_deg": number(-360, 360)}
FORCE = {"force_N": number(0.005, 0.02)}
TOUCH = {"start_s": number(0, 0.05), "end_s": number(0.25, PERIOD), "rise_s": number(0.01, 0.09), **PLACE, **FORCE}
PATHS = st.one_of(
    st.fixed_dictionaries(
        {"kind": st.just("sine"), **TOUCH, "amplitude_N": number(0, 0.005), "frequency_Hz": number(1, 400)}
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("sweep"),
            **TOUCH,
            "amplitude_N": number(0, 0.005),
            "frequency_Hz": number(1, 400),
            "end_frequency_Hz": number(1, 400),
        }
    ),
    st.fixed_dictionaries({"kind": st.just("slide"), **TOUCH, "to_x_mm": number(-3, 3), "to_y_mm": number(-3, 3)}),
    st.fixed_dictionaries({"kind": st.just("twist"), **TOUCH, "to_angle_deg": number(-90, 90)}),
    st.fixed_dictionaries(
        {
            "kind": st.just("random"),
            **TOUCH,
            "amplitude_N": number(0, 0.005),
            "reach_mm": number(0, 1),
            "bandwidth_Hz": number(1, 100),
            "seed": st.integers(0, 99),
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("tap"),
            "start_s": number(0, 0.05),
            "contact_s": number(0.005, 0.05),
            "interval_s": number(0.05, 0.1),
            "count": st.integers(1, 4),
            **PLACE,
            **FORCE,
        }
    ),
)
KEYFRAMES = st.lists(st.fixed_dictionaries({**PLACE, **FORCE}), min_size=1, max_size=4).map(
    lambda frames: [{"time_s": 0.05 + 0.09 * index, **frame} for index, frame in enumerate([*frames, frames[0]])]
)
OBJECT = st.tuples(KINDS, PATHS.map(lambda path: {"path": path}) | KEYFRAMES.map(lambda frames: {"keyframes": frames}))
CHIP: st.SearchStrategy[dict[str, Any]] = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"bend_radius_mm": number(5, 100), "bend_axis": st.sampled_from("xy")}),
    st.fixed_dictionaries({"cover_thickness_mm": number(0.3, 1.5)}),
)
SCENES = st.builds(
    lambda chip, objects: {
        "name": "random",
        "description": "made by a test",
        "period_s": PERIOD,
        "temperature_degC": 25.0,
        **chip,
        "objects": [{"name": f"object{index}", **kind, **path} for index, (kind, path) in enumerate(objects)],
    },
    CHIP,
    st.lists(OBJECT, max_size=3),
)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=SCENES, seed=st.integers(0, 9))
def test_a_valid_scene_runs_with_consistent_ground_truth(tmp_path: Path, scene: dict[str, Any], seed: int) -> None:
    path = tmp_path / "random.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    loaded = load_scene(path, SENSOR)
    board = SimulatedBoard(SENSOR, SceneLoads(loaded, SENSOR), seed)
    scan = Scan.empty(LAYOUT.id, LAYOUT.taxels)
    loads = SceneLoads(loaded, SENSOR)
    for index in (0, 60, 130, 131, 333, 555):
        board.scan(index, scan)
        truth = board.truth()
        objects = truth.objects
        pressed = np.zeros((LAYOUT.rows, LAYOUT.cols))
        for patch in loads.forces([truth.time]):
            assert patch.force.shape == (1, *pressed[patch.rows, patch.cols].shape)
            pressed[patch.rows, patch.cols] += patch.force[0]
        np.testing.assert_allclose(truth.force, pressed.ravel(), rtol=0, atol=1e-15)
        assert truth.force.sum() <= objects.contact_forces.sum() * (1 + 1e-12)
        assert (objects.contact_forces > 0).all()
        assert len(objects.contact_objects) == len(objects.contact_centres) == len(objects.contact_normals)
        np.testing.assert_allclose(np.linalg.norm(objects.orientations, axis=1), 1, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(objects.contact_normals, axis=1), 1, atol=1e-12)
        columns, row = truth_columns(LAYOUT, objects.names), truth_row(truth)
        assert len(columns) == len(row) == len(set(columns))


def test_a_csv_row_agrees_with_the_ground_truth(tmp_path: Path) -> None:
    loaded = load_scene("two_fingers", SENSOR)
    board = SimulatedBoard(SENSOR, SceneLoads(loaded, SENSOR), 0)
    board.scan(600, Scan.empty(LAYOUT.id, LAYOUT.taxels))
    truth = board.truth()
    row = dict(zip(truth_columns(LAYOUT, truth.objects.names), truth_row(truth), strict=True))
    assert (row["sequence"], row["time_s"], row["chip_temperature_degC"]) == (600, 0.6, 25.0)
    assert row["lower.force_N"] == pytest.approx(0.8, abs=1e-12)
    assert (row["lower.contact_x_m"], row["lower.contact_y_m"], row["lower.normal_z"]) == (-2e-3, -2e-3, 1.0)
    assert row["lower.z_m"] < 1.5e-3
    assert (row["upper.force_N"], row["upper.z_m"]) == (0.0, 1.5e-3)
    assert math.isnan(row["upper.contact_x_m"])
    assert row["force_0_0_N"] == truth.force[0]
    assert row["force_4_3_N"] == truth.force[23]
    assert row["status_2_2"] == 0


def test_objects_stand_on_the_normal_of_a_bent_chip(tmp_path: Path) -> None:
    path = tmp_path / "bent.yaml"
    frames = [{"time_s": 0.0, "x_mm": 3.0, "y_mm": 1.0, "angle_deg": 30.0, "force_N": 0.5}]
    ball = {"name": "ball", "kind": "sphere", "radius_mm": 4.0, "effective_modulus_MPa": 2.0, "keyframes": frames}
    text = {"name": "bent", "description": "-", "temperature_degC": 25.0, "objects": [ball]}
    for axis, along in (("y", 0), ("x", 1)):
        bent = {"bend_radius_mm": 20.0, "bend_axis": axis}
        path.write_text(yaml.safe_dump({**text, **bent}), encoding="utf-8")
        loads = SceneLoads(load_scene(path, SENSOR), SENSOR)
        objects = loads.objects(0.0)
        tilt = (3e-3, 1e-3)[along] / 20e-3
        centre = np.array([3e-3, 1e-3, -20e-3])  # axis of the cylinder of the bent chip
        centre[along] = 0.0
        (state,) = loads.scene.states(0.0)
        arm = objects.positions[0] - centre
        np.testing.assert_allclose(np.linalg.norm(arm), 24e-3 - state.indentation, rtol=1e-12)
        normal = arm / np.linalg.norm(arm)
        np.testing.assert_allclose(objects.contact_normals[0], normal, atol=1e-12)
        assert normal[along] == pytest.approx(math.sin(tilt), abs=1e-12)
        np.testing.assert_allclose(rotated(objects.orientations[0], [0, 0, 1]), normal, atol=1e-12)
        forward = np.array([math.cos(math.pi / 6), math.sin(math.pi / 6), 0.0])
        lifted = rotated(objects.orientations[0], [1, 0, 0])
        assert lifted[1 - along] == pytest.approx(forward[1 - along], abs=1e-12)  # unchanged along the axis
        np.testing.assert_allclose(objects.contact_centres, [[3e-3, 1e-3]], atol=1e-15)


def rotated(quaternion: np.ndarray, vector: list[float]) -> np.ndarray:
    x, y, z, w = quaternion
    axis = np.array([x, y, z])
    return np.asarray(vector) + 2 * np.cross(axis, np.cross(axis, vector) + w * np.asarray(vector))
