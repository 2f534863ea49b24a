# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Each effect of a real film against its closed form, alone and switched off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.board_effects import BoardEffects
from posfet_sim.device.error_model import ErrorModel, load_error_model
from posfet_sim.device.film import (
    CHIP_TIME_CONSTANT,
    CREEP_TIME_CONSTANTS,
    MINOR_HALF_WIDTHS,
    REFERENCE_TEMPERATURE,
    RELAXATION_TIME_CONSTANTS,
    WARMTH_FORCE,
    Film,
)
from posfet_sim.device.film_effects import FILM_KEYS, SHAPES, FilmEffects
from posfet_sim.device.random_streams import Stream
from posfet_sim.device.random_walk import RandomWalk
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.device.taxel_charge import TaxelCharge
from posfet_sim.device.taxel_variation import draw_taxel_parameters
from posfet_sim.loads import ObjectsState, Patch
from posfet_sim.scene import SceneLoads, load_scene
from support.paths import DOCS

SENSOR = load_sensor()
TAXELS, FULL = SENSOR.layout.taxels, SENSOR.device.force_max
IDEAL, MODERATE, HARD = FilmEffects.ideal(), FilmEffects.moderate(), FilmEffects.hard()
SILENT = ErrorModel.none().without_noise()
EFFECTS = [field.name for field in fields(FilmEffects) if field.name not in SHAPES]
DOCUMENT = (DOCS / "simulation.md").read_text(encoding="utf-8")
AT_ONCE = 1e-9
"""Duration of a force step [s] that no time constant notices."""


def film(seed: int = 0, temperature: float = REFERENCE_TEMPERATURE, **effects: float) -> Film:
    return Film(SENSOR, replace(IDEAL, **effects), temperature, seed)


def respond(of: Film, force: Sequence[float], steps: Sequence[float], rise: float = 0.0) -> np.ndarray:
    """Return the effective force on the first taxel for the same force [N] on every taxel."""
    every = np.repeat(np.array(force, float)[:, None], TAXELS, axis=1)
    return of.respond(every, every, np.full(len(every), rise), np.array(steps, float)).force[:, 0]


def held(of: Film, times: Sequence[float], force: float = 1.0) -> np.ndarray:
    """Return the effective force at these times after a force has come up at once."""
    steps = np.diff(times, prepend=0.0)
    return respond(of, [force] * (len(steps) + 1), [AT_ONCE, *steps])[1:]


class OneTaxel:
    """A constant force [N] on one taxel from scan 1 to a time [s]: one at scan 0 would have acted before."""

    live = False

    def __init__(self, row: int, col: int, force: float, end: float = math.inf) -> None:
        self.place, self.force, self.end = (row, col), force, end
        self.name = "one taxel"

    def forces(self, times: Sequence[float]) -> list[Patch]:
        row, col = self.place
        after, before = np.array(times) > 0.0, np.array(times) < self.end
        force = np.where(after & before, self.force, 0.0)
        return [Patch(slice(row, row + 1), slice(col, col + 1), force[:, None, None])]

    def temperatures(self, times: Sequence[float]) -> list[float]:
        return [REFERENCE_TEMPERATURE] * len(times)

    def constant_until(self, time: float) -> float:
        return time if time < self.end else math.inf

    def objects(self, time: float) -> ObjectsState:
        none, no_vectors = np.zeros(0), np.zeros((0, 3))
        return ObjectsState((), no_vectors, np.zeros((0, 4)), none.astype(int), np.zeros((0, 2)), no_vectors, none)


def board(loads: object, seed: int = 0, **effects: float) -> SimulatedBoard:
    model = replace(SILENT, film=replace(IDEAL, **effects))
    return SimulatedBoard(SENSOR, loads, seed, model)  # type: ignore[arg-type]


def at(of: SimulatedBoard, index: int) -> SimulatedBoard:
    of.scan(index, Scan.empty(1, TAXELS))
    return of


def relative_force(of: SimulatedBoard, index: int) -> np.ndarray:
    """Return the charge as a force, without what has leaked from a force since scan 1; [N] on every taxel."""
    unit = at(board(OneTaxel(0, 0, 1.0)), index).charge()[0]
    return at(of, index).charge() / unit


@pytest.mark.parametrize("share", [MODERATE.relaxation, HARD.relaxation, -0.02])
def test_the_charge_of_a_held_force_relaxes_by_its_share_in_each_of_three_decades(share: float) -> None:
    times = np.array([0.01, 0.1, 1.0, 10.0])
    found = np.diff(held(film(relaxation=share), times))
    # Poles beyond the ends of the bank are missing: their part of each decade, and 0.2 % of ripple, bound the error.
    shortest, longest = RELAXATION_TIME_CONSTANTS[0], RELAXATION_TIME_CONSTANTS[-1]
    beyond = 10.0 ** (np.arange(1, 20) / 2)
    missing = [
        sum(np.exp(-start / tau) - np.exp(-10 * start / tau) for tau in (*longest * beyond, *shortest / beyond)) / 2
        for start in times[:-1]
    ]
    np.testing.assert_array_less(np.abs(found - share) / abs(share), np.array(missing) + 2e-3)
    assert max(missing) < 0.08


def test_creep_grows_by_its_share_within_its_time_constants() -> None:
    times = np.array([0.001, 1.0, 10.0, 200.0])
    found = held(film(creep=0.04), times) - 1.0
    expected = 0.04 * np.mean([1 - np.exp(-times / tau) for tau in CREEP_TIME_CONSTANTS], axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    assert found[-1] == pytest.approx(0.04, rel=1e-6)


def test_what_crept_is_left_after_a_release_and_decays() -> None:
    creeping = film(creep=0.04)
    held(creeping, [100.0])
    left = respond(creeping, [0.0, 0.0, 0.0], [AT_ONCE, 1.0, 100.0])
    assert left[0] == pytest.approx(0.04, rel=1e-3)
    assert left[1] == pytest.approx(0.04 * np.mean(np.exp(-1.0 / np.array(CREEP_TIME_CONSTANTS))), rel=1e-3)
    assert abs(left[2]) < 1e-5


@pytest.mark.parametrize("steps", [[1e-6] * 4, [0.1, 50.0, 1e-4, 1e6]])
def test_any_step_is_exact_for_a_linear_force_and_stable(steps: list[float]) -> None:
    coarse, fine = film(relaxation=0.03, creep=0.08), film(relaxation=0.03, creep=0.08)
    ends = np.array([1.0, 3.0, 0.5, 0.5])
    found = respond(coarse, ends, steps)
    forces, parts = [], []
    for start, end, step in zip([0.0, *ends[:-1]], ends, steps, strict=True):
        forces += [start + (end - start) * part / 10 for part in range(1, 11)]
        parts += [step / 10] * 10
    np.testing.assert_allclose(found, respond(fine, forces, parts)[9::10], rtol=1e-9)
    share = 0.03 * len(RELAXATION_TIME_CONSTANTS) / 2 + 0.08
    assert np.abs(found - ends).max() <= share * ends.max()


@pytest.mark.parametrize("peak", [0.2, 0.4, 0.8])
@pytest.mark.parametrize("width", [MODERATE.minor_loops, HARD.minor_loops])
def test_a_small_loop_of_hysteresis_closes_and_has_its_width(peak: float, width: float) -> None:
    hysteretic = film(minor_loops=width)
    up = np.linspace(0.0, peak, 101)
    steps = np.full(len(up), 1e-3)
    respond(hysteretic, up, steps)
    down, again = respond(hysteretic, up[::-1], steps)[::-1], respond(hysteretic, up, steps)
    # At half of the peak A, a play of half-width r opens the loop by min(2*r, A - 2*r), if that is positive:
    # half-widths that double from r0 on give A - 2*r0 in sum.
    assert (down - again)[50] == pytest.approx(width * (peak - 2 * MINOR_HALF_WIDTHS[0] * FULL), rel=1e-9)
    assert (down - again)[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert (down - again).min() > -1e-12


def test_preload_raises_the_response_to_a_small_change() -> None:
    for preload in (0.0, 1.0, 3.0):
        low, high = respond(film(preload_nonlinearity=0.02), [preload, preload + 1e-4], [1e-3, 1e-3])
        assert (high - low) / 1e-4 == pytest.approx(1 + 0.02 * preload, abs=1e-5)


def test_d33_follows_the_film_temperature() -> None:
    warm = film(d33_temperature=0.005, temperature=REFERENCE_TEMPERATURE + 4.0)
    found = respond(warm, [1.0], [1e-3], rise=6.0) / respond(film(d33_temperature=0.005), [1.0], [1e-3])
    assert found == pytest.approx([math.exp(0.05)])
    slight = respond(film(d33_temperature=0.005), [1.0], [1e-3], rise=0.01)
    assert slight - 1 == pytest.approx([5e-5], rel=1e-3)


@pytest.mark.parametrize(("halving", "rise"), [(15.0, 15.0), (10.0, 10.0), (15.0, -15.0), (10.0, 20.0)])
def test_leakage_is_twice_as_fast_where_the_film_is_warmer_by_its_constant(halving: float, rise: float) -> None:
    leaking = TaxelCharge(
        SENSOR,
        draw_taxel_parameters(SENSOR, SILENT, 0),
        0.0,
        False,
        film(leak_halving=halving, temperature=REFERENCE_TEMPERATURE + rise),
    )
    steps = np.array([AT_ONCE, 0.1, 0.25])
    charge = leaking.advance(np.ones((3, TAXELS)), np.zeros(3), steps)[1:, 0]
    rate = 2.0 ** (rise / halving) / SENSOR.device.leak_time_constant
    np.testing.assert_allclose(charge / charge[0], np.exp(-rate * np.array([0.0, 0.1, 0.35])), rtol=1e-9)


def test_leakage_drifts_as_the_square_root_of_time() -> None:
    # 500 boards: the sampling deviation of a standard deviation is 1/sqrt(2*500) = 3.2 % of it, of which 4 are allowed.
    step = np.array([1e-3])
    nothing = np.zeros((1, TAXELS))
    for minutes in (1.0, 4.0):
        logs = []
        for seed in range(500):
            drifting = film(seed, leak_drift=MODERATE.leak_drift)
            drifting.respond(nothing, nothing, np.zeros(1), np.array([60.0 * minutes]))
            factor = drifting.respond(nothing, nothing, np.zeros(1), step).leak_factor
            assert factor is not None
            logs.append(np.log(factor[0, :2]))
        first, second = np.array(logs).T
        assert first.std() == pytest.approx(0.01 * math.sqrt(minutes), rel=0.13)
        # Half of the variance is common. The deviation of a correlation of 0.5 is (1 - 0.5^2)/sqrt(500) = 0.034.
        assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.5, abs=0.14)


def test_a_random_walk_depends_on_seed_and_time_only() -> None:
    times = np.sort(np.random.default_rng(0).uniform(0.0, 300.0, 200))
    once = RandomWalk(5, Stream.LEAK_DRIFT, 3).at(times)
    often = RandomWalk(5, Stream.LEAK_DRIFT, 3)
    np.testing.assert_array_equal(np.concatenate([often.at(part) for part in np.split(times, 8)]), once)
    assert not np.array_equal(RandomWalk(6, Stream.LEAK_DRIFT, 3).at(times), once)
    many = RandomWalk(5, Stream.LEAK_DRIFT, 4000).at(np.array([0.0, 100.0]))
    assert not many[0].any()
    assert many[1].std() == pytest.approx(10.0, rel=0.045)  # 4/sqrt(2*4000)


@pytest.mark.parametrize("time_constant", [MODERATE.contact_warmth_time, 0.2, 4.0])
@pytest.mark.parametrize("warmth", [MODERATE.contact_warmth, HARD.contact_warmth])
def test_an_object_warms_the_film_of_the_taxels_it_touches_with_its_time_constant(
    warmth: float, time_constant: float
) -> None:
    warm = film(contact_warmth=warmth, contact_warmth_time=time_constant)
    force = np.zeros((3, TAXELS))
    force[:, 7], force[:, 8] = 3.0, WARMTH_FORCE
    steps = np.array([AT_ONCE, time_constant, 40.0 * time_constant])
    rise = warm.respond(force, force, np.zeros(3), steps).temperature_rise
    assert rise[:, 7] == pytest.approx([0.0, warmth * (1 - 1 / math.e), warmth], abs=1e-7)
    assert rise[2, 8] == pytest.approx(warmth * (1 - 1 / math.e), abs=1e-7)
    assert not np.delete(rise, [7, 8], axis=1).any()
    released = warm.respond(0 * force, 0 * force, np.zeros(3), steps).temperature_rise
    assert released[:, 7] == pytest.approx([warmth, warmth / math.e, 0.0], abs=1e-7)


def test_the_warmth_of_a_touch_generates_pyroelectric_charge() -> None:
    plain, warm = at(board(OneTaxel(2, 2, 1.0)), 0), at(board(OneTaxel(2, 2, 1.0), contact_warmth=0.1), 0)
    for index in range(1, 5):  # short against leakage and warmth
        plain, warm = at(plain, index), at(warm, index)
    expected = SENSOR.device.pyroelectric_coefficient * 0.1 * (3.5e-3 / FilmEffects.ideal().contact_warmth_time)
    assert (warm.charge() - plain.charge())[12] == pytest.approx(expected, rel=0.02)  # (3.5 ms)/(0.27 s) leaks


@pytest.mark.parametrize("warming", [MODERATE.chip_warming, HARD.chip_warming])
def test_an_object_warms_chip_sensors_and_film_by_its_force(warming: float) -> None:
    found, scan = board(OneTaxel(2, 2, 2.0), chip_warming=warming), Scan.empty(1, TAXELS)
    found.scan(5000, scan)
    # The force comes up within the first interval of 1 ms.
    expected = 2.0 * warming * (1 - math.exp(-4.9995 / CHIP_TIME_CONSTANT))
    assert found.truth().chip_temperature - REFERENCE_TEMPERATURE == pytest.approx(expected, rel=1e-6)
    assert list(scan.temperatures) == pytest.approx([found.truth().chip_temperature] * 2)
    rate = 2.0 * warming / CHIP_TIME_CONSTANT * math.exp(-1.0)
    lag = found.truth().chip_temperature - found.truth().film_temperature
    assert lag == pytest.approx(rate * SENSOR.device.thermal_time_constant, rel=0.02)  # 0.05 s of 5 s


@pytest.mark.parametrize("bending", [MODERATE.bending, HARD.bending])
def test_bending_puts_the_same_charge_on_every_taxel_when_the_force_is_in_the_middle(bending: float) -> None:
    force = relative_force(board(OneTaxel(2, 2, 3.0), bending=bending), 5)
    untouched = np.delete(force, 12)
    np.testing.assert_allclose(untouched, 3.0 * bending, rtol=1e-9)
    assert force[12] == pytest.approx(3.0 * (1 + bending))


def test_bending_is_larger_on_the_side_of_the_force() -> None:
    force = relative_force(board(OneTaxel(0, 0, 1.0), bending=2e-3, bending_gradient=0.5), 1).reshape(5, 5)
    assert force[0, 0] == pytest.approx(1 + 2e-3 * 1.5)
    assert force[4, 4] == pytest.approx(2e-3 * 0.5)
    assert force[2, 2] == pytest.approx(2e-3)
    assert force[0, 4] == pytest.approx(2e-3)
    assert force[0, 2] == pytest.approx(2e-3 * 1.25)


def test_gain_drifts_at_a_rate_of_each_taxel() -> None:
    large = replace(SENSOR, layout=replace(SENSOR.layout, rows=40, cols=40))
    ones = np.ones((2, 1600))
    effects = replace(IDEAL, gain_drift=MODERATE.gain_drift)
    hours = [
        Film(large, effects, REFERENCE_TEMPERATURE, seed).respond(ones, ones, np.ones(2), np.array([3600.0, 3600.0]))
        for seed in (1, 1, 2)
    ]
    logs = np.log(hours[0].force)
    assert logs[0].std() == pytest.approx(0.01, rel=0.07)  # 4/sqrt(2*1600)
    np.testing.assert_allclose(logs[1], 2 * logs[0], rtol=1e-9)
    np.testing.assert_array_equal(hours[0].temperature_rise, hours[0].force)
    np.testing.assert_array_equal(hours[0].force, hours[1].force)
    assert not np.array_equal(hours[0].force, hours[2].force)


def test_random_effects_do_not_depend_on_the_others() -> None:
    force = np.ones((3, TAXELS))
    steps = np.full(3, 100.0)
    alone = film(3, gain_drift=1e-5).respond(force, force, np.zeros(3), steps)
    both = film(3, gain_drift=1e-5, leak_drift=1e-3, leak_halving=15.0).respond(force, force, np.zeros(3), steps)
    np.testing.assert_array_equal(both.force, alone.force)
    drift = film(3, leak_drift=1e-3).respond(force, force, np.zeros(3), steps).leak_factor
    assert drift is not None
    np.testing.assert_array_equal(both.leak_factor, drift)


STATES = {
    "relaxation": "_delayed", "creep": "_delayed", "minor_loops": "_plays", "leak_halving": "_leak_before",
    "leak_drift": "_leak_walk", "contact_warmth": "_warmth", "bending": "_bending", "gain_drift": "_gain_rate",
}  # fmt: skip
"""State of each effect that has one."""


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_that_is_off_has_no_state(effect: str) -> None:
    alone = film(**{effect: getattr(MODERATE, effect)})
    needed = {STATES[effect]} if effect in STATES else set()
    if effect == "leak_drift":
        needed.add("_leak_before")
    found = {name for name in STATES.values() if getattr(alone, name) is not None}
    assert found == needed


def test_without_effects_there_is_no_film_and_untouched_taxels_are_not_computed() -> None:
    assert not IDEAL.any_on
    resting = board(OneTaxel(0, 0, 1.0, end=0.01))
    creeping = board(OneTaxel(0, 0, 1.0, end=0.01), creep=0.04)
    for index in range(100):
        at(resting, index)
        at(creeping, index)
    assert resting.taxel_updates < 0.3 * creeping.taxel_updates


@pytest.mark.parametrize("effect", EFFECTS)
def test_each_effect_alone_changes_the_charge_and_not_the_true_force(effect: str) -> None:
    scene = SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR)
    warmer = {"d33_temperature", "leak_halving"}  # need another temperature than that of the reference
    also = {"chip_warming": 1.0} if effect in warmer else {}
    plain = board(scene, **also) if also else board(scene)
    real = board(scene, **also, **{effect: getattr(MODERATE, effect)})
    for index in (300, 900, 1500):
        at(plain, index)
        at(real, index)
    np.testing.assert_array_equal(real.truth().force, plain.truth().force)
    assert np.abs(real.charge() - plain.charge()).max() > 1e-7 * np.abs(plain.charge()).max()


def test_scans_do_not_depend_on_which_scans_are_requested_and_the_seed_repeats_them() -> None:
    model = replace(ErrorModel.default(), film=HARD)
    scene = SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR)
    every, some, other = (SimulatedBoard(SENSOR, scene, seed, model) for seed in (3, 3, 4))
    scan, counts = Scan.empty(1, TAXELS), {}
    for index in range(900):
        every.scan(index, scan)
        counts[index] = scan.counts.copy()
    for index in [*range(70), *range(100, 860, 37), *range(870, 900)]:
        some.scan(index, scan)
        np.testing.assert_array_equal(scan.counts, counts[index])
    other.scan(899, scan)
    assert not np.array_equal(scan.counts, counts[899])


def test_a_hard_film_is_farther_from_an_ideal_one_than_a_moderate_film() -> None:
    for name in EFFECTS:
        ideal, moderate, hard = (getattr(each, name) for each in (IDEAL, MODERATE, HARD))
        assert ideal == 0.0 < moderate
        assert hard <= moderate if name == "leak_halving" else hard >= moderate
    errors = []
    scene = SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR)
    reference = SimulatedBoard(SENSOR, scene, 0, SILENT)
    films = [SimulatedBoard(SENSOR, scene, 0, replace(SILENT, film=effects)) for effects in (IDEAL, MODERATE, HARD)]
    for index in range(100, 2000, 100):
        truth = at(reference, index).volts()
        errors.append([np.abs(at(each, index).volts() - truth).max() for each in films])
    ideal, moderate, hard = np.array(errors).mean(axis=0)
    assert ideal == 0.0
    assert hard > 1.5 * moderate > 0.0


def test_single_precision_stays_close() -> None:
    scene = SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR)
    model = replace(SILENT, film=HARD)
    double = at(SimulatedBoard(SENSOR, scene, 0, model), 900)
    single = at(SimulatedBoard(SENSOR, scene, 0, model, single_precision=True), 900)
    np.testing.assert_allclose(single.charge(), double.charge(), atol=1e-4 * np.abs(double.charge()).max())


def test_every_field_has_a_key_and_every_size_is_within_its_range() -> None:
    assert [key.attribute for key in FILM_KEYS] == [field.name for field in fields(FilmEffects)]
    for key in FILM_KEYS:
        for effects in (IDEAL, MODERATE, HARD):
            assert key.low <= getattr(effects, key.attribute) / key.scale <= key.high


def test_the_document_lists_every_effect_with_its_sizes_and_range() -> None:
    rows = {row.split("|")[1].strip().strip("`"): row for row in DOCUMENT.splitlines() if row.startswith("| `film.")}
    for key in FILM_KEYS:
        moderate, hard = (getattr(each, key.attribute) / key.scale for each in (MODERATE, HARD))
        assert f"| {moderate:g} | {hard:g} | [{key.low:g}, {key.high:g}] |" in rows[f"film.{key.name}"]


def test_a_file_or_name_selects_the_realism_and_single_keys_override_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "base: none\nrealism: hard\nfilm: {creep_percent: 6, bending_mN_per_N: 0, hysteresis_percent: 1}\n"
        "mains: {amplitude_mV: 2, third_harmonic_percent: 0}\n"
    )
    expected = replace(
        ErrorModel.none(),
        hysteresis=0.01,
        film=replace(HARD, creep=0.06, bending=0.0),
        board=replace(BoardEffects.hard(), third_harmonic=0.0),
        hum_amplitude=2e-3,
        clock_jitter=5e-6,
        drop_probability=1e-3,
    )
    assert load_error_model(path) == expected
    path.write_text("base: default\nfilm: {gain_drift_percent_per_h: 3.6}\n")
    film_of_default = ErrorModel.default().film
    assert load_error_model(path).film == replace(film_of_default, gain_drift=pytest.approx(1e-5))
    for size, effects in (("moderate", MODERATE), ("hard", HARD)):
        assert load_error_model(size) == ErrorModel.default().with_realism(size)
        assert load_error_model(size).film == effects


def test_an_invalid_realism_or_effect_is_rejected_with_a_one_line_error(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    for text, reason in (
        ("realism: worst", "realism: must be one of ideal, moderate, hard, got 'worst'"),
        ("film: {creep_percent: 31}", "film.creep_percent: must be a number in [-30, 30], got 31"),
        ("film: {crepe_percent: 3}", "film.crepe_percent: unknown key"),
    ):
        path.write_text(f"base: none\n{text}\n")
        with pytest.raises(ConfigError) as error:
            load_error_model(path)
        assert reason in str(error.value)
        assert "\n" not in str(error.value)
