# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Effects of the readout board: each is off by default, and acts alone as described."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.board_effects import BOARD_KEYS, LEVELS, BoardEffects, affected_taxels
from posfet_sim.device.error_model import ErrorModel, load_error_model
from posfet_sim.device.film_effects import FilmEffects
from posfet_sim.device.interference import Interference
from posfet_sim.device.mains_hum import MainsHum
from posfet_sim.device.readout import Readout
from posfet_sim.device.sample_clock import SampleClock
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.device.taxel_variation import draw_taxel_parameters
from posfet_sim.scene import Keyframes, SceneLoads, load_scene
from support.paths import DOCS

SENSOR = load_sensor()
TAXELS = SENSOR.layout.taxels
RATE = SENSOR.can.scan_rate
SILENT = ErrorModel.none().without_noise()
LSB = (SENSOR.adc.high - SENSOR.adc.low) / 65535
OFF = BoardEffects()
HARD = replace(ErrorModel.default().with_realism("hard"), film=FilmEffects.ideal())
"""A hard board with an ideal film."""
SEED = 3


def with_effects(**values: float) -> ErrorModel:
    """Return an ideal board without noise but for these effects."""
    return replace(SILENT, board=BoardEffects(**values))


def board(model: ErrorModel, scene: str = "idle", sensor: Sensor = SENSOR, *, full: bool = False) -> SimulatedBoard:
    return SimulatedBoard(sensor, SceneLoads(load_scene(scene, sensor), sensor), SEED, model, compute_all=full)


def counts(model: ErrorModel, scans: int, scene: str = "idle", sensor: Sensor = SENSOR) -> np.ndarray:
    """Return the counts of the first scans, shape [scans, taxels]."""
    simulated, scan = board(model, scene, sensor), Scan.empty(1, TAXELS)
    result = np.empty((scans, TAXELS), np.int64)
    for index in range(scans):
        simulated.scan(index, scan)
        result[index] = scan.counts
    return result


def test_every_effect_is_off_by_default_and_has_two_levels_and_a_key() -> None:
    assert ErrorModel.none().board == ErrorModel.default().board == OFF
    names = [field.name for field in fields(BoardEffects)]
    assert not any(getattr(OFF, name) for name in names)
    assert [level.attribute for level in LEVELS] == [key.attribute for key in BOARD_KEYS] == names
    for key, level in zip(BOARD_KEYS, LEVELS, strict=True):
        assert 0 < level.moderate <= level.hard
        assert key.low <= key.default <= level.hard / key.scale <= key.high


def test_the_levels_include_hum_jitter_and_lost_scans() -> None:
    base = ErrorModel.default()
    moderate, hard = base.with_realism("moderate"), base.with_realism("hard")
    assert (moderate.board, hard.board) == (BoardEffects.moderate(), BoardEffects.hard())
    for model, hum in ((moderate, 0.5e-3), (hard, 5e-3)):
        assert (model.hum_amplitude, model.clock_jitter, model.drop_probability) == (hum, 5e-6, 1e-3)
        same = {"film": base.film, "board": OFF, "hum_amplitude": base.hum_amplitude, "clock_jitter": base.clock_jitter}
        assert replace(model, **same, drop_probability=base.drop_probability) == base  # type: ignore[arg-type]
    ideal = hard.with_realism("ideal")
    assert (ideal.film, ideal.board) == (base.film, OFF)
    assert ideal.hum_amplitude == hard.hum_amplitude


def test_a_file_switches_each_effect_on_alone(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    for key, level in zip(BOARD_KEYS, LEVELS, strict=True):
        value = level.hard if isinstance(level.hard, int) else level.hard / key.scale
        path.write_text(f"base: none\n{key.section}: {{{key.name}: {value!r}}}\n")
        effects = load_error_model(path).board
        assert getattr(effects, key.attribute) == pytest.approx(level.hard, rel=1e-12)
        assert replace(effects, **{key.attribute: key.default}) == OFF
    path.write_text("base: none\nadc: {stuck_bit: 1.5}\n")
    with pytest.raises(ConfigError, match=r"adc.stuck_bit: must be a whole number"):
        load_error_model(path)


def test_the_document_lists_every_effect_with_its_levels() -> None:
    text = (DOCS / "simulation.md").read_text(encoding="utf-8")
    rows = {row.split("|")[1].strip().strip("`"): row for row in text.splitlines() if row.startswith("| `")}
    for key, level in zip(BOARD_KEYS, LEVELS, strict=True):
        row = rows[f"{key.section}.{key.name}"]
        assert f"| {level.moderate / key.scale:g} | {level.hard / key.scale:g} | [{key.low:g}, {key.high:g}] |" in row


def readings(model: ErrorModel, scene_slope: float, scans: int) -> np.ndarray:
    """Return the temperature readings [degC], shape [scans, sensors], while the chip warms at a rate [K/s]."""
    idle = load_scene("idle", SENSOR)
    # Keyframes are connected by minimum-jerk paths: of a long one the middle is a ramp, its slope 15/8 of the mean.
    span = 40.0
    ramp = Keyframes((-span / 2, span / 2), ((25 - 4 * scene_slope * span / 15,), (25 + 4 * scene_slope * span / 15,)))
    simulated = SimulatedBoard(SENSOR, SceneLoads(replace(idle, temperature=ramp), SENSOR), SEED, model)
    scan, found = Scan.empty(1, TAXELS), np.empty((scans, 2))
    for index in range(scans):
        simulated.scan(index, scan)
        found[index] = scan.temperatures
    return found


def test_the_temperature_sensors_lag_by_their_time_constant() -> None:
    lag, slope = 0.1, 0.5
    late, prompt = (readings(model, slope, 1001) for model in (with_effects(sensor_lag=lag), SILENT))
    behind = (prompt - late)[:, 0]
    time = np.arange(1001) / RATE
    # Linear warming: slope*tau*(1 - exp(-t/tau)). The path deviates from its tangent by 4e-4 K within 1 s; readings
    # are float32, 1e-6 K at 25 degC.
    np.testing.assert_allclose(behind, slope * lag * (1 - np.exp(-time / lag)), rtol=0, atol=5e-4)
    np.testing.assert_array_equal(late[:, 0], late[:, 1])


def test_each_temperature_sensor_has_a_constant_offset() -> None:
    off, exact = (readings(model, 0.5, 50) for model in (with_effects(sensor_offset=0.3), SILENT))
    error = off - exact
    assert np.ptp(error, axis=0).max() < 1e-5  # float32
    assert 0 < abs(error[0, 0]) < 1.5
    assert error[0, 0] != error[0, 1]
    offsets = [
        SimulatedBoard(
            SENSOR, SceneLoads(load_scene("idle", SENSOR), SENSOR), seed, with_effects(sensor_offset=0.3)
        )._sensors.offsets
        for seed in range(200)
    ]
    assert np.std(np.array(offsets)) == pytest.approx(0.3, rel=0.15)  # 400 numbers: 3.5 % standard error


def test_sensors_that_lag_settle_and_then_skip_computation() -> None:
    stepped, skipped = (board(with_effects(sensor_lag=0.1), "temperature_ramp") for _ in range(2))
    one, other = Scan.empty(1, TAXELS), Scan.empty(1, TAXELS)
    for index in range(9000):
        stepped.scan(index, one)
    skipped.scan(8999, other)
    np.testing.assert_allclose(one.temperatures, other.temperatures, rtol=0, atol=1e-5)


def test_mains_hum_has_its_harmonics() -> None:
    model = replace(with_effects(third_harmonic=0.2, fifth_harmonic=0.1), hum_amplitude=10e-3, hum_frequency=50.0)
    signal = counts(model, 1000) * LSB
    spectrum = np.abs(np.fft.rfft(signal - signal.mean(axis=0), axis=0)) / 500
    amplitude = draw_taxel_parameters(SENSOR, model, SEED).hum
    for line, relative in ((50, 1.0), (150, 0.2), (250, 0.1)):
        np.testing.assert_allclose(spectrum[line], relative * amplitude, rtol=0, atol=LSB / 2)
    spectrum[[0, 50, 150, 250]] = 0
    assert spectrum.max() < LSB / 2


def test_the_mains_frequency_wanders_within_its_limit() -> None:
    hum = MainsHum(np.ones(1), 50.0, BoardEffects(frequency_wander=0.2), None, SEED)
    times = np.arange(0, 600, 0.05)
    frequency = np.diff(hum.cycles(times)) / 0.05
    assert np.abs(frequency - 50).max() <= 0.2 * (1 + 1e-6)
    assert np.ptp(frequency) > 0.2
    assert frequency.mean() == pytest.approx(50.0, abs=0.01)
    assert hum.cycles(np.zeros(1))[0] == 0.0


def test_a_burst_disturbs_all_taxels_in_a_single_scan() -> None:
    model = with_effects(burst_rate=5.0, burst_amplitude=20e-3)
    quiet = counts(SILENT, 1)[0]
    change = (counts(model, 20_000) - quiet) * LSB
    hit = np.flatnonzero(np.abs(change).max(axis=1) > LSB)
    assert len(hit) == pytest.approx(100, abs=40)  # Poisson: four standard deviations
    assert np.abs(change[hit]).max() <= 20e-3 + LSB
    assert change[hit].std() == pytest.approx(20e-3 / math.sqrt(2), rel=0.05)  # 2500 samples of a sine
    assert abs(np.corrcoef(change[hit, 0], change[hit, 1])[0, 1]) < 0.5


def test_telegraph_noise_has_two_levels_on_one_taxel() -> None:
    model = with_effects(telegraph_amplitude=3e-3, telegraph_dwell=0.1)
    change = counts(model, 3000) - counts(SILENT, 1)[0]
    (taxel,) = np.flatnonzero(np.abs(change).max(axis=0))
    assert taxel == affected_taxels(np.zeros(TAXELS, np.uint8), SEED).telegraph
    levels = np.unique(change[:, taxel])
    assert len(levels) == 2
    assert levels[0] == 0
    assert levels[1] * LSB == pytest.approx(3e-3, abs=LSB)  # both codes are rounded


def test_telegraph_dwell_times_have_their_mean_whatever_times_are_asked_for() -> None:
    effects = BoardEffects(telegraph_amplitude=1e-3, telegraph_dwell=0.1)
    every = Interference(effects, TAXELS, 0, 1e-3, SEED).telegraph_state(np.arange(0, 500, 1e-3))
    late = Interference(effects, TAXELS, 0, 1e-3, SEED).telegraph_state(np.arange(400_000, 500_000) * 1e-3)
    np.testing.assert_array_equal(late, every[400_000:])
    # 5000 expected, of which the scans miss those that switch back within an interval: 1 %; standard deviation 70.
    assert np.count_nonzero(np.diff(every)) == pytest.approx(4950, abs=280)


def test_a_stuck_bit_never_changes_and_the_other_bits_do() -> None:
    noisy = replace(SILENT, adc_noise=True, board=BoardEffects(stuck_bit=7))
    without = replace(noisy, board=OFF)
    found, expected = counts(noisy, 1500, "press"), counts(without, 1500, "press")
    taxel = affected_taxels(np.zeros(TAXELS, np.uint8), SEED).stuck_bit
    others = np.arange(TAXELS) != taxel
    np.testing.assert_array_equal(found[:, others], expected[:, others])
    bit = found[:, taxel] >> 7 & 1
    assert bit.min() == bit.max()
    assert np.ptp(expected[:, taxel] >> 7 & 1) == 1  # it would change
    np.testing.assert_array_equal(found[:, taxel] & ~128, expected[:, taxel] & ~128)


@pytest.mark.parametrize("bits", [12, 16])
def test_missing_codes_read_as_the_next_lower_one(bits: int) -> None:
    sensor = replace(SENSOR, adc=replace(SENSOR.adc, bits=bits))
    model = replace(with_effects(missing_codes=0.2), amplifier_rails=False)
    readout = Readout(sensor, model, draw_taxel_parameters(sensor, model, 0), SampleClock(RATE, 0.0, 0.0, 0), SEED)
    codes = np.arange(1 << bits, dtype=np.float64)
    found = readout._convert(codes.copy(), None) >> (16 - bits)
    assert len(np.unique(found)) == pytest.approx(0.8 * len(codes), rel=0.03)  # 4096: 0.6 % standard error
    missing = found != codes
    np.testing.assert_array_equal(found[1:][missing[1:]], found[:-1][missing[1:]])


def test_taxels_are_sampled_one_after_another() -> None:
    # A board of twice the rate samples halfway: the middle of a skew of one interval falls on its scans.
    fast = replace(SENSOR, can=replace(SENSOR.can, scan_rate=2 * RATE))
    skewed, halfway = board(with_effects(taxel_skew=1e-3), "press"), board(SILENT, "press", fast)
    scan = Scan.empty(1, TAXELS)
    late = np.empty((2, TAXELS))
    for index in range(350, 400):
        skewed.scan(index, scan)
        halfway.scan(2 * index - 1, scan)
        late[0] = halfway.volts()
        halfway.scan(2 * index, scan)
        late[1] = halfway.volts()
        share = 1 - np.arange(TAXELS) / TAXELS  # of an interval, before the end of the scan
        expected = late[1] - (late[1] - late[0]) * 2 * share
        # Both interpolate linearly, over 1 ms and 0.5 ms: the error is below h^2/2 times the largest second derivative
        # of the force, 5.8*1.5 N/(0.2 s)^2, so 1.1e-4 N, of which a taxel carries at most 0.4.
        np.testing.assert_allclose(skewed.volts(), expected, rtol=0, atol=1.1e-4 * 0.4 * SENSOR.volts_per_newton)
    assert np.abs(late[1] - late[0]).max() > 10 * 1.1e-4 * 0.4 * SENSOR.volts_per_newton


def test_hum_has_the_phase_of_each_taxel_s_sampling_time() -> None:
    model = replace(with_effects(taxel_skew=0.5e-3), hum_amplitude=1.0)  # 1e-4 rad for half an LSB
    signal = counts(model, 1000) * LSB
    line = np.fft.rfft(signal, axis=0)[50]
    phase = np.unwrap(np.angle(line))
    delay = 0.5e-3 * (1 - np.arange(TAXELS) / TAXELS)
    np.testing.assert_allclose(phase - phase[0], -2 * math.pi * 50 * (delay - delay[0]), rtol=0, atol=1e-3)


def test_scans_of_a_hard_board_do_not_depend_on_which_scans_are_requested() -> None:
    model = HARD
    every = counts(model, 1000, "press_slide_lift")
    simulated, scan = board(model, "press_slide_lift"), Scan.empty(1, TAXELS)
    for index in [*range(130), *range(200, 900, 37), *range(930, 1000)]:
        simulated.scan(index, scan)
        np.testing.assert_array_equal(scan.counts, every[index])


def test_skipped_computation_does_not_change_the_result_of_a_hard_board() -> None:
    model = HARD.without_noise()
    lazy, full = board(model, "press"), board(model, "press", full=True)
    scan = Scan.empty(0, TAXELS)
    for index in range(1500):
        lazy.scan(index, scan)
        full.scan(index, scan)
        np.testing.assert_allclose(lazy.volts(), full.volts(), rtol=0, atol=1e-12 * SENSOR.adc.high)
    assert lazy.taxel_updates < full.taxel_updates
