# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""ErrorModel: each error can be switched off alone, acts as documented, and is read with its unit and range."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain
from posfet_sim.device.error_model import KEYS, SENSOR_PROPERTIES, ErrorModel, load_error_model
from posfet_sim.device.readout import Readout
from posfet_sim.device.sample_clock import SampleClock
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.device.taxel_charge import TaxelCharge
from posfet_sim.device.taxel_variation import TaxelStatus, draw_taxel_parameters
from posfet_sim.scene import Keyframes, Scene, SceneLoads, load_scene
from support.paths import DOCS

SENSOR = load_sensor()
LARGE = replace(SENSOR, layout=replace(SENSOR.layout, rows=40, cols=40))
NONE, DEFAULT = ErrorModel.none(), ErrorModel.default()
SILENT = NONE.without_noise()
TAXELS = SENSOR.layout.taxels
DOCUMENT = DOCS / "simulation.md"


def run(error_model: ErrorModel, scans: int, sensor: Sensor = SENSOR, scene: str = "press_slide_lift") -> np.ndarray:
    """Return the counts of the first scans, shape [scans, taxels]."""
    board = SimulatedBoard(sensor, SceneLoads(load_scene(scene, sensor), sensor), 3, error_model)
    scan = Scan.empty(1, sensor.layout.taxels)
    result = np.empty((scans, sensor.layout.taxels), np.uint16)
    for index in range(scans):
        board.scan(index, scan)
        result[index] = scan.counts
    return result


def in_volts(counts: np.ndarray) -> np.ndarray:
    return counts * ((SENSOR.adc.high - SENSOR.adc.low) / 65535) + SENSOR.adc.low


def volts(error_model: ErrorModel, index: int = 700, sensor: Sensor = SENSOR, scene: Scene | None = None) -> np.ndarray:
    """Return the noise-free output of one scan [V]."""
    board = SimulatedBoard(sensor, SceneLoads(scene or load_scene("press_slide_lift", sensor), sensor), 3, error_model)
    scan = Scan.empty(1, sensor.layout.taxels)
    for each in range(index + 1):
        board.scan(each, scan)
    return board.volts()


def test_without_errors_the_board_equals_the_ideal_signal_chain() -> None:
    spread = draw_taxel_parameters(SENSOR, NONE, 0)
    assert not spread.status.any()
    for values in (spread.charge_per_newton, spread.leak_time_constant, spread.volts_per_charge, spread.offset):
        assert np.ptp(values) == 0
    resting = ForwardSignalChain(SENSOR).volts()
    np.testing.assert_allclose(volts(SILENT, 10), resting, atol=1e-15)


@pytest.mark.parametrize("key", KEYS, ids=lambda key: key.attribute)
def test_each_error_alone_changes_the_board_and_is_off_in_none(key: object) -> None:
    name = key.attribute  # type: ignore[attr-defined]
    only = replace(SILENT, **{name: getattr(DEFAULT, name)})
    needs = {"hum_frequency": "hum_amplitude", "noisy_factor": "adc_noise", "reset_time": "resets_per_hour"}
    if name in SENSOR_PROPERTIES:
        assert getattr(NONE, name) is True  # set in the sensor file, and on by default
        assert SILENT.adc_noise is False
    elif name not in needs:
        assert only != SILENT
        assert not getattr(SILENT, name)
    assert all(hasattr(DEFAULT, need) for need in needs.values())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gain_spread", 0.05), ("area_spread", 0.03), ("offset_spread", 5e-3), ("leak_spread", 0.1),
        ("crosstalk", 0.02), ("dead_probability", 0.5), ("hysteresis", 0.01), ("amplifier_pole", True),
        ("slew_rate", 0.5),
    ],
)  # fmt: skip
def test_each_signal_error_acts_alone(name: str, value: float) -> None:
    assert np.abs(volts(replace(SILENT, **{name: value}), 400) - volts(SILENT, 400)).max() > 1e-7


def test_parameter_spreads_have_the_requested_standard_deviation() -> None:
    spread = draw_taxel_parameters(
        LARGE, replace(NONE, gain_spread=0.05, offset_spread=5e-3, leak_spread=0.1, area_spread=0.03), 1
    )
    for values, expected in (
        (spread.volts_per_charge / spread.volts_per_charge.mean(), 0.05),
        (spread.charge_per_newton / spread.charge_per_newton.mean(), 0.03),
        (spread.offset / LARGE.amplifier.follower_gain, 5e-3),
        (np.log(spread.leak_time_constant), 0.1),
    ):
        assert values.std() == pytest.approx(expected, rel=0.06)  # 1600 taxels: 1.8 % standard error


def test_area_acts_on_force_and_not_on_temperature() -> None:
    idle = load_scene("idle", SENSOR)
    warmer = replace(idle, temperature=Keyframes((0.0, 0.2), ((25.0,), (30.0,))))
    uneven = replace(SILENT, area_spread=0.2)
    np.testing.assert_array_equal(volts(uneven, 300, scene=warmer), volts(SILENT, 300, scene=warmer))
    assert np.ptp(volts(replace(SILENT, gain_spread=0.2), 300, scene=warmer)) > 0.05
    assert np.abs(volts(replace(SILENT, pyroelectric=False), 300, scene=warmer)).max() < 1e-12


def test_crosstalk_reaches_the_four_neighbours() -> None:
    model = replace(SILENT, crosstalk=0.1)
    clock = SampleClock(SENSOR.can.scan_rate, 0.0, 0.0, 0)
    readout = Readout(SENSOR, model, draw_taxel_parameters(SENSOR, model, 0), clock, 0)
    active = np.array([6, 7, 8, 1, 2, 3, 11, 12, 13])
    readout.activate(active)
    charge = np.zeros((2, 9))
    charge[:, 1] = 1e-6  # taxel 7, row 1, column 2
    (output,) = readout.outputs(charge, np.array([1e-3]))
    volts = readout.volts(active, output)
    expected = np.zeros(TAXELS)
    expected[7] = 1.0
    expected[[6, 8, 2, 12]] = 0.1
    np.testing.assert_allclose(volts / volts[7], expected, atol=1e-12)


def test_dead_stuck_and_noisy_taxels_behave_as_described() -> None:
    faulty = replace(NONE, dead_probability=0.2, stuck_probability=0.2, noisy_probability=0.2, noisy_factor=10.0)
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR), 3, faulty)
    status = board.taxel_status
    counts = run(faulty, 1500).astype(float)
    spread = draw_taxel_parameters(SENSOR, faulty, 3)
    stuck = status == TaxelStatus.STUCK
    assert {int(value) for value in status} == {TaxelStatus.OK, TaxelStatus.DEAD, TaxelStatus.STUCK}
    assert np.ptp(counts[:, stuck], axis=0).max() == 0
    np.testing.assert_array_equal(counts[0, stuck], spread.stuck_counts[stuck])
    signal = counts[600:900].mean(axis=0) - counts[:300].mean(axis=0)
    dead = status == TaxelStatus.DEAD
    noise = in_volts(counts[:300]).std(axis=0)
    assert np.abs(signal[dead & (spread.noise_factor == 1)]).max() < 1
    assert noise[~stuck & (spread.noise_factor > 1)].min() > 5 * noise[~stuck & (spread.noise_factor == 1)].max()


def test_hysteresis_loop_has_the_specified_width() -> None:
    width, greatest = 0.02, SENSOR.device.force_max
    parameters = draw_taxel_parameters(SENSOR, SILENT, 0)
    charge = TaxelCharge(SENSOR, parameters, width, compute_all=True)
    instant = np.array([1e-18])  # [s], too short for any leakage

    def counted(force: float) -> float:
        density = charge.advance(np.full((1, TAXELS), force), np.zeros(1), instant)[-1, 0]
        return float(density / parameters.charge_per_newton[0])

    for force in np.linspace(0, greatest, 50):
        up = counted(force)
        if force <= greatest / 2:
            middle, up_middle = force, up
    for force in np.linspace(greatest, middle, 50):
        down = counted(force)
    assert down - up_middle == pytest.approx(width * greatest, rel=0.05)
    for force in np.linspace(middle, greatest, 50):
        again = counted(force)
    assert again == pytest.approx(up, abs=1e-12)  # the loop closes
    assert counted(greatest) == again  # a constant force changes nothing


def test_mains_hum_has_its_frequency_and_amplitude() -> None:
    hum = replace(SILENT, hum_amplitude=10e-3, hum_frequency=50.0)
    signal = in_volts(run(hum, 1000, scene="idle"))
    spectrum = np.abs(np.fft.rfft(signal - signal.mean(axis=0), axis=0)) / 500
    assert (spectrum.argmax(axis=0) == 50).all()
    expected = draw_taxel_parameters(SENSOR, hum, 3).hum
    half_a_step = (SENSOR.adc.high - SENSOR.adc.low) / 65535 / 2  # the sampling is synchronous with the hum
    np.testing.assert_allclose(spectrum[50], expected, rtol=0, atol=half_a_step)
    assert 0.1 < expected.std() / expected.mean() < 0.3


def test_output_saturates_at_the_supply_rails_and_the_adc_range() -> None:
    sensor = replace(SENSOR, amplifier=replace(SENSOR.amplifier, rail_high=0.05, rail_low=-0.01))
    assert volts(SILENT, 700, sensor).max() == pytest.approx(0.05, abs=1e-12)
    narrow = replace(SENSOR, adc=replace(SENSOR.adc, high=0.1, low=-0.1))
    counts = run(NONE, 900, narrow)
    assert counts.max() == 65535


def test_errors_of_the_sensor_file_can_be_switched_off() -> None:
    amplifier = replace(SENSOR.amplifier, rail_high=0.05, offset=3e-3, open_loop_gain=20.0)
    sensor = replace(SENSOR, amplifier=amplifier, adc=replace(SENSOR.adc, bits=8))
    rest, pressed = volts(SILENT, 10, sensor), volts(SILENT, 700, sensor)
    np.testing.assert_allclose(rest, 3e-3 * 20 / 21, rtol=1e-9)
    np.testing.assert_array_equal(volts(replace(SILENT, amplifier_offset=False), 10, sensor), 0.0)
    np.testing.assert_allclose(volts(replace(SILENT, amplifier_gain=False), 10, sensor), 3e-3, rtol=1e-9)
    assert pressed.max() == pytest.approx(0.05, abs=1e-12)
    assert volts(replace(SILENT, amplifier_rails=False), 700, sensor).max() > 0.06
    free = replace(SILENT, amplifier_rails=False, quantisation=False)
    in_steps, fine = run(replace(free, quantisation=True), 900, sensor), run(free, 900, sensor)
    assert len(np.unique(in_steps)) < 64 < len(np.unique(fine))
    exact = volts(free, 899, sensor)
    half_a_step = (sensor.adc.high - sensor.adc.low) / 65535 / 2
    np.testing.assert_allclose(in_volts(fine[899]), exact, rtol=0, atol=half_a_step * (1 + 1e-9))


def test_a_slow_amplifier_rises_at_its_slew_rate() -> None:
    slew = 2.0  # [V/s]: 2 mV a scan
    board = SimulatedBoard(
        SENSOR, SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR), 3, replace(SILENT, slew_rate=slew)
    )
    scan = Scan.empty(1, TAXELS)
    before, steepest = board.volts(), 0.0
    for index in range(600):
        board.scan(index, scan)
        steepest = max(steepest, np.abs(board.volts() - before).max())
        before = board.volts()
    assert steepest == pytest.approx(slew / SENSOR.can.scan_rate, rel=1e-9)


def test_the_follower_lags_by_its_time_constant() -> None:
    lagging, prompt = volts(replace(SILENT, amplifier_pole=True), 400), volts(SILENT, 400)
    slope = (volts(SILENT, 401) - prompt) * SENSOR.can.scan_rate
    loop = SENSOR.amplifier.gain_bandwidth * (1 + SENSOR.amplifier.open_loop_gain) / SENSOR.amplifier.open_loop_gain
    middle = np.abs(slope).argmax()
    assert (prompt - lagging)[middle] == pytest.approx(slope[middle] / (2 * math.pi * loop), rel=0.05)


def test_a_12_bit_adc_repeats_its_high_bits_in_the_low_bits() -> None:
    sensor = replace(SENSOR, adc=replace(SENSOR.adc, bits=12))
    counts = run(NONE, 700, sensor)
    np.testing.assert_array_equal(counts & 0xF, counts >> 12)
    assert np.unique(counts).size > 20


def test_the_clock_drifts_and_jitters() -> None:
    clock = SampleClock(1000.0, 100e-6, 5e-6, 1)
    times = clock.times(0, 20_000)
    errors = times - np.arange(20_000) * 1e-3 * (1 + 100e-6)
    assert (np.diff(times) > 0).all()
    assert errors.min() >= 0
    assert errors.std() == pytest.approx(5e-6, rel=0.05)
    for index in (0, 17, 9999):
        assert clock.time(index) == times[index]
        assert times[clock.last_by(times[index] + 1e-3)] <= times[index] + 1e-3
    scan = Scan.empty(1, TAXELS)
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("idle", SENSOR), SENSOR), 0, replace(NONE, clock_drift=100e-6))
    board.scan(10_000, scan)
    assert scan.stamp - 10_000_000_000 == 1_000_000
    assert scan.device_time == 10_000_000  # by the board clock


@pytest.mark.parametrize("error_model", [NONE, DEFAULT], ids=["none", "default"])
def test_scans_do_not_depend_on_which_scans_are_requested(error_model: ErrorModel) -> None:
    every = run(error_model, 1000)
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR), 3, error_model)
    scan = Scan.empty(1, TAXELS)
    for index in [*range(130), *range(200, 900, 37), *range(930, 1000)]:
        board.scan(index, scan)
        np.testing.assert_array_equal(scan.counts, every[index])


def test_another_seed_gives_another_board() -> None:
    first, second = (draw_taxel_parameters(SENSOR, DEFAULT, seed) for seed in (1, 2))
    assert not np.array_equal(first.offset, second.offset)
    np.testing.assert_array_equal(first.offset, draw_taxel_parameters(SENSOR, DEFAULT, 1).offset)
    only_gain = draw_taxel_parameters(SENSOR, replace(NONE, gain_spread=0.05), 1)
    np.testing.assert_array_equal(only_gain.volts_per_charge, first.volts_per_charge)  # one random stream for each


def test_every_field_has_a_key_and_every_default_is_within_its_range() -> None:
    own = {"film", "board"}  # have their own keys
    assert sorted(key.attribute for key in KEYS) == sorted({field.name for field in fields(ErrorModel)} - own)
    for key in KEYS:
        if not isinstance(key.default, bool):
            assert key.low <= key.default / key.scale * (1 + 1e-12)
            assert key.default / key.scale * (1 - 1e-12) <= key.high


def test_a_file_gives_its_base_model_and_the_differences(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "base: default\ntaxels: {gain_spread_percent: 2.5, crosstalk_percent: 0}\nfilm: {pyroelectric: false}\n"
    )
    assert load_error_model(path) == replace(DEFAULT, gain_spread=0.025, crosstalk=0.0, pyroelectric=False)
    path.write_text("base: none\n")
    assert load_error_model(path) == NONE
    assert (load_error_model("none"), load_error_model("default")) == (NONE, DEFAULT)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("taxels: {}\n", "base: missing, must be one of none, default"),
        ("base: some\n", "base: must be one of none, default, got 'some'"),
        (
            "base: none\ntaxels: {gain_spread_percent: 31}\n",
            "taxels.gain_spread_percent: must be a number in [0, 30], got 31",
        ),
        ("base: none\ntaxels: {gain: 3}\n", "taxels.gain: unknown key"),
        ("base: none\nfilms: {}\n", "films: unknown key, did you mean film? known here are base, taxels, film"),
        ("base: none\nfilm: {pyroelectric: 1}\n", "film.pyroelectric: must be true or false, got 1"),
        ("base: none\nclock: {jitter_us: .nan}\n", "clock.jitter_us: must be a number in [0, 1000], got nan"),
        ("base: none\nclock: 3\n", "clock: must be a mapping"),
    ],
)
def test_an_invalid_file_is_rejected_with_a_one_line_error(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as error:
        load_error_model(path)
    assert str(error.value).startswith(f"{path}: ")
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_the_document_lists_every_key_with_its_default_and_range() -> None:
    rows = {
        row.split("|")[1].strip().strip("`"): row
        for row in DOCUMENT.read_text(encoding="utf-8").splitlines()
        if row.startswith("| `")
    }
    for key in KEYS:
        row = rows[f"{key.section}.{key.name}"]
        if isinstance(key.default, bool):
            assert f"| {str(key.default).lower()} |" in row
        else:
            assert f"| {key.default / key.scale:g} |" in row
            assert f"| [{key.low:g}, {key.high:g}] |" in row
