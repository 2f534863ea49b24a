# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board: reproducible scans, states that do not depend on skipped scans, and skipped computation."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_model.sensor.signal_chain import ForwardSignalChain, charge_per_newton
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import OVERTEMPERATURE, SimulatedBoard
from posfet_sim.scene import SCENE_FOLDER, Keyframes, Scene, SceneLoads, load_scene
from support.long_cases import long_cases

SENSOR = load_sensor()
QUIET = replace(SENSOR, adc=replace(SENSOR.adc, noise=0.0))
FORGETFUL = replace(QUIET, device=replace(QUIET.device, leak_time_constant=0.01, thermal_time_constant=0.005))
SCENES = (
    "flat_pad_fast", "grasp_lift_slip", "hold", "idle", "press", "press_slide_lift", "slide", "tap", "temperature_ramp",
    "texture", "two_fingers", "two_fingers_slide", "vibration", "warm_finger",
)  # fmt: skip
"""Shipped scenes of every kind of path and load; the others differ in what the forces are, which is tested on them."""
DIFFERENT = pytest.mark.parametrize(
    "name",
    long_cases(
        SCENES, ["flat_pad_fast", "grasp_lift_slip", "press_slide_lift", "two_fingers", "vibration", "warm_finger"]
    ),
)
"""In the ordinary run those that differ most: an edge, a cylinder, a slide, two objects, a sine, a temperature."""
TAXELS = SENSOR.layout.taxels
RATE = SENSOR.can.scan_rate
FULL_SCALE = SENSOR.device.force_max * charge_per_newton(SENSOR)  # [C/m2]
SAME = 1e-12 * FULL_SCALE


def warming(scene: Scene) -> Scene:
    """Return the scene with a temporary temperature rise of 5 K."""
    return replace(scene, temperature=Keyframes((0.6, 1.1, 2.0, 2.4), ((25.0,), (30.0,), (30.0,), (25.0,))))


def run(board: SimulatedBoard, indices: Iterable[int]) -> bytes:
    scan = Scan.empty(0, TAXELS)
    recorded = b""
    for index in indices:
        board.scan(index, scan)
        recorded += scan.counts.tobytes() + scan.temperatures.tobytes()
    return recorded


def test_scans_are_reproducible_by_seed() -> None:
    scene = load_scene("two_fingers", SENSOR)
    first, second, other = (
        run(SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), seed), range(1500)) for seed in (7, 7, 8)
    )
    assert first == second
    assert first != other


def test_without_noise_the_counts_do_not_depend_on_the_seed() -> None:
    scene = load_scene("two_fingers", QUIET)
    assert run(SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 1), range(800)) == run(
        SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 2), range(800)
    )


@DIFFERENT
@pytest.mark.parametrize("warm", [False, True])
def test_skipping_scans_gives_the_same_state_as_stepping(name: str, warm: bool) -> None:
    scene = load_scene(name, QUIET)
    scene = warming(scene) if warm else scene
    stepped, skipped = (
        SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 0),
        SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 0),
    )
    last = -1
    for index in (0, 1, 320, 700, 701, 1400):
        there = run(stepped, range(last + 1, index + 1))[-TAXELS * 2 - 8 :]
        assert run(skipped, [index]) == there
        np.testing.assert_allclose(skipped.charge(), stepped.charge(), rtol=0, atol=SAME)
        last = index


def test_a_gap_longer_than_the_charge_memory_discards_the_history() -> None:
    scene = warming(load_scene("press_slide_lift", QUIET))
    stepped, skipped = (
        SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 0),
        SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 0),
    )
    for board in (stepped, skipped):
        run(board, range(600))
    run(stepped, range(600, 13_201))
    run(skipped, [13_200])
    np.testing.assert_allclose(skipped.charge(), stepped.charge(), rtol=0, atol=SAME)
    assert skipped.taxel_updates < 0.7 * stepped.taxel_updates
    assert stepped.in_contact


@DIFFERENT
@pytest.mark.parametrize("sensor", [QUIET, FORGETFUL], ids=["slow leak", "fast leak"])
def test_skipped_computation_does_not_change_the_result(name: str, sensor: Sensor) -> None:
    scene = load_scene(name, sensor)
    scene = replace(scene, temperature=Keyframes((0.6, 1.1), ((25.0,), (30.0,)))) if name == "idle" else scene
    board = SimulatedBoard(sensor, SceneLoads(scene, sensor), 0)
    scan = Scan.empty(0, TAXELS)
    for index, chain in enumerate(full_computation(sensor, scene, 1200)):
        board.scan(index, scan)
        assert np.abs(board.volts() - chain.volts()).max() <= 1e-12 * sensor.adc.high
        assert np.abs(board.charge() - chain.charge).max() <= SAME


@DIFFERENT
def test_skipped_computation_does_not_change_the_result_with_the_error_model(name: str) -> None:
    imperfections = replace(ErrorModel.default().without_noise(), clock_jitter=20e-6, slew_rate=5e3)
    scene = load_scene(name, SENSOR)
    lazy, full = (
        SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 5, imperfections, compute_all=full) for full in (False, True)
    )
    scan = Scan.empty(0, TAXELS)
    for index in range(1000):
        lazy.scan(index, scan)
        full.scan(index, scan)
        assert np.abs(lazy.volts() - full.volts()).max() <= 1e-12 * SENSOR.adc.high
    assert full.taxel_updates == 1000 * TAXELS
    if scene.temperature_rise is None:
        assert lazy.taxel_updates < full.taxel_updates
    else:
        assert lazy.taxel_updates <= 1024 * TAXELS, "every taxel changes in every scan; scans are computed ahead"


@pytest.mark.parametrize("name", long_cases(SCENES, ["grasp_lift_slip", "vibration", "warm_finger"]))
def test_the_error_against_full_computation_at_100_khz_is_below_one_thousandth(name: str) -> None:
    # 40 ms from the first change; benchmarks/simulation/runs.py covers whole scenes.
    scene = load_scene(name, QUIET)
    begin = math.floor(min(SceneLoads(scene, QUIET).constant_until(0.0), 1.0) * RATE)
    board, scan = SimulatedBoard(QUIET, SceneLoads(scene, QUIET), 0), Scan.empty(0, TAXELS)
    largest = 0.0
    for index, chain in enumerate(full_computation(QUIET, scene, 4001, 100 * RATE, 100 * begin)):
        if index % 100 == 0:
            board.scan(begin + index // 100, scan)
            largest = max(largest, np.abs(board.volts() - chain.volts()).max())
    assert largest < 1e-3 * SENSOR.device.force_max * SENSOR.volts_per_newton


def full_computation(
    sensor: Sensor, scene: Scene, scans: int, rate: float = RATE, begin: int = 0
) -> Iterable[ForwardSignalChain]:
    """Every taxel in every scan, with the closed-form film temperature; nothing may change before `begin`."""
    chain = ForwardSignalChain(sensor)
    loads = SceneLoads(scene, sensor)
    ratio = 1 / rate / sensor.device.thermal_time_constant
    chip = film = loads.temperatures([0.0])[0]
    for index in range(begin, begin + scans):
        forces = np.zeros((sensor.layout.rows, sensor.layout.cols))
        for patch in loads.forces([index / rate]):
            forces[patch.rows, patch.cols] += patch.force[0]
        before, chip = chip, loads.temperatures([index / rate])[0]
        slope = (chip - before) / ratio  # change of the chip in one time constant: the lag of a steady ramp
        film = chip - slope + (film - before + slope) * math.exp(-ratio)
        chain.advance(forces.ravel(), film, 1 / rate)
        yield chain


@pytest.mark.parametrize("name", SCENES)
def test_the_ground_truth_is_consistent(name: str) -> None:
    scene = load_scene(name, SENSOR)
    board = SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0)
    touched = 0
    for index in range(0, 4000, 37):
        run(board, [index])
        truth = board.truth()
        pressed = truth.objects.contact_forces.sum()
        assert truth.sequence == index
        assert truth.time == pytest.approx(index / RATE, abs=1e-12)
        assert truth.objects.names == tuple(item.name for item in scene.objects)
        assert truth.force.sum() <= pressed + 1e-12
        if name in {
            "press_slide_lift",
            "two_fingers",
            "hold",
            "press",
        }:  # away from the edge, where part of the spread force is lost
            assert truth.force.sum() == pytest.approx(pressed, rel=0.01)
        assert not truth.taxel_status.any()
        assert board.in_contact == (pressed > 1e-8)
        touched += board.in_contact
    assert bool(touched) == (name not in {"idle", "temperature_ramp"})


def test_the_ground_truth_is_a_copy_unaffected_by_the_next_scan() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR), 0)
    run(board, [500])
    truth = board.truth()
    before = truth.force.copy()
    run(board, [1500])
    np.testing.assert_array_equal(truth.force, before)
    assert not np.array_equal(board.truth().force, before)


def test_the_ground_truth_reports_the_indentation_of_the_sphere() -> None:
    scene = load_scene("hold", SENSOR)
    board = SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0)
    (ball,) = scene.objects
    run(board, [100])
    assert board.truth().objects.positions[0, 2] == ball.shape.radius
    run(board, [10_000])
    indentation = (9 * 2.0**2 / (16 * ball.shape.radius * ball.shape.effective_modulus**2)) ** (1 / 3)
    np.testing.assert_allclose(
        board.truth().objects.positions, [[0.2e-3, -0.1e-3, ball.shape.radius - indentation]], atol=1e-15
    )


def test_a_press_raises_the_count_of_the_taxel_by_the_specified_sensitivity() -> None:
    # The press of 0.2 s is not short against the leakage of 0.27 s: between half and all of the charge remains.
    board = SimulatedBoard(QUIET, SceneLoads(load_scene("hold", QUIET), QUIET), 0)
    scan = Scan.empty(0, TAXELS)
    board.scan(0, scan)
    rest = scan.counts[12]
    board.scan(1200, scan)
    volts = (float(scan.counts[12]) - float(rest)) * (QUIET.adc.high - QUIET.adc.low) / 65535
    assert 0.5 < volts / (board.truth().force[12] * QUIET.volts_per_newton) < 1.0


def test_an_idle_board_updates_no_taxels() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("idle", SENSOR), SENSOR), 0)
    run(board, [*range(500), 600_000])
    assert board.taxel_updates == 0


def test_a_held_force_needs_no_computation_after_its_charge_has_leaked() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("hold", SENSOR), SENSOR), 0)
    run(board, range(1200))
    run(board, range(1200, 1200 + math.ceil(32 * SENSOR.device.leak_time_constant * RATE)))
    settled = board.taxel_updates
    run(board, range(10_000, 10_300))
    assert board.taxel_updates == settled
    run(board, [61_200])
    assert board.taxel_updates == settled
    run(board, [61_201])
    assert settled < board.taxel_updates <= settled + 2 * TAXELS


def test_a_gap_at_rest_is_computed_in_one_step() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR), 0)
    run(board, range(3000))
    before = board.taxel_updates
    run(board, [4250])
    assert board.taxel_updates <= before + TAXELS


def test_chip_sensors_read_the_scene_and_the_film_lags() -> None:
    slope = 5.0  # [K/s]
    idle = load_scene("idle", SENSOR)
    steps = np.arange(0, 1.001, 0.01)
    ramp = Keyframes(tuple(steps), tuple((25 + slope * time,) for time in steps))  # dense keyframes: a linear ramp
    board = SimulatedBoard(SENSOR, SceneLoads(replace(idle, temperature=ramp), SENSOR), 0)
    scan = Scan.empty(0, TAXELS)
    for index in range(1001):
        board.scan(index, scan)
    assert scan.temperatures.tolist() == [30.0, 30.0]
    lag = slope * SENSOR.device.thermal_time_constant
    assert board.truth().film_temperature == pytest.approx(30.0 - lag, abs=5e-3 * lag + 0.02 * lag)
    run(board, [5000])
    assert board.truth().film_temperature == 30.0


def test_a_film_without_thermal_lag_has_the_chip_temperature() -> None:
    sensor = replace(SENSOR, device=replace(SENSOR.device, thermal_time_constant=0.0))
    board = SimulatedBoard(sensor, SceneLoads(warming(load_scene("idle", sensor)), sensor), 0)
    run(board, [850])
    assert board.truth().film_temperature == pytest.approx(27.5, abs=1e-9)


def test_a_hot_chip_sets_the_over_temperature_flag(tmp_path: Path) -> None:
    text = (SCENE_FOLDER / "idle.yaml").read_text(encoding="utf-8")
    for temperature, status in ((OVERTEMPERATURE, ScanStatus.OK), (OVERTEMPERATURE + 1, ScanStatus.OVERTEMPERATURE)):
        path = tmp_path / "hot.yaml"
        path.write_text(text.replace("25.0", str(temperature)), encoding="utf-8")
        scan = Scan.empty(0, TAXELS)
        SimulatedBoard(SENSOR, SceneLoads(load_scene(path, SENSOR), SENSOR), 0).scan(0, scan)
        assert scan.status == status


def test_every_field_of_a_scan_is_filled() -> None:
    scan = Scan.empty(0, TAXELS)
    SimulatedBoard(SENSOR, SceneLoads(load_scene("idle", SENSOR), SENSOR), 0).scan(1234, scan)
    assert (scan.layout_id, scan.sequence, scan.stamp, scan.device_time) == (1, 1234, 1_234_000_000, 1_234_000)
    assert scan.frames_lost == 0


def test_computing_ahead_does_not_change_the_last_scan() -> None:
    scene = load_scene("press_slide_lift", SENSOR)
    board, same = (
        SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 4),
        SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 4),
    )
    scan = Scan.empty(0, TAXELS)
    for index in range(300, 420):
        there = run(board, [index])
        truth, volts, charge = board.truth(), board.volts(), board.charge()
        board.prepare(index + 1)
        assert board.truth().sequence == index
        np.testing.assert_array_equal(board.truth().force, truth.force)
        np.testing.assert_array_equal(board.volts(), volts)
        np.testing.assert_array_equal(board.charge(), charge)
        same.scan(index, scan)
        assert scan.counts.tobytes() == there[: 2 * TAXELS]
    with pytest.raises(ValueError, match="index must be above 419"):
        board.prepare(419)


def test_float32_agrees_with_float64_to_single_precision() -> None:
    scene = load_scene("tap", SENSOR)
    wide, narrow = (
        SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0, single_precision=each) for each in (False, True)
    )
    scan = Scan.empty(0, TAXELS)
    for index in range(800):
        wide.scan(index, scan)
        narrow.scan(index, scan)
    full_scale = SENSOR.device.force_max * SENSOR.volts_per_newton
    np.testing.assert_allclose(narrow.volts(), wide.volts(), rtol=0, atol=1e-6 * full_scale)
    assert np.abs(narrow.charge() - wide.charge()).max() > SAME


def test_invalid_parameters_are_rejected() -> None:
    scene = load_scene("idle", SENSOR)
    with pytest.raises(ValueError, match=r"seed must be in \[0, 1000000000\], got -1"):
        SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), -1)
    board = SimulatedBoard(SENSOR, SceneLoads(scene, SENSOR), 0)
    run(board, [5])
    with pytest.raises(ValueError, match="index must be above 5"):
        run(board, [5])
