# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sweeps, the Pareto front against a definition, tolerances against independent formulas and counting."""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from posfet_model.design import report, sweep
from posfet_model.design.design_file import load_design
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.sweep import Axis, Sweep, pareto_front, run_sweep
from posfet_model.design.tolerance import CMRR, KEYS, OFFSET, QUANTILES, Limit, Tolerance, run_tolerance

DESIGN = PosfetDesign()
RANGES = Sweep((Axis("film_thickness", 1e-6, 4e-6, 3, log=True), Axis("supply", 1.2, 5.0, 2)))


def test_a_sweep_gives_what_each_design_gives() -> None:
    done: list[int] = []
    result = run_sweep(DESIGN, RANGES, progress=done.append)
    assert done == [6]
    for i, (thickness, supply) in enumerate((t, s) for t in (1e-6, 2e-6, 4e-6) for s in (1.2, 5.0)):
        one = PosfetDesign(film_thickness=thickness, supply=supply)
        assert result.valid[i] == one.valid
        for key, value in report.values(one).items():
            np.testing.assert_allclose(result.figures[key][i], value, rtol=1e-9, err_msg=key)
    assert not result.valid[::2].any()
    assert not result.pareto[::2].any()
    counted = Counter(reason for supply in (1.2, 5.0) for reason in _reasons_over_thickness(supply))
    assert result.reasons == dict(counted)
    assert list(result.reasons.values()) == sorted(result.reasons.values(), reverse=True)


def _reasons_over_thickness(supply: float) -> list[str]:
    designs = [PosfetDesign(film_thickness=thickness, supply=supply) for thickness in (1e-6, 2e-6, 4e-6)]
    return [reason for design in designs for reason in design.reasons]


def test_the_csv_has_a_row_for_each_design() -> None:
    lines = run_sweep(DESIGN, RANGES).csv().splitlines()
    header = lines[0].split(",")
    assert header == ["film_thickness", "supply", *report.KEYS, "valid", "pareto"]
    table = np.loadtxt(lines[1:], delimiter=",")
    assert table.shape == (6, len(header))
    assert table[1, header.index("gain_db")] == pytest.approx(
        float(PosfetDesign(film_thickness=1e-6).amplifier.gain_db), rel=1e-10
    )
    assert np.isnan(table[0, header.index("lowest_input_v")])


def test_large_sweeps_are_computed_in_chunks_and_by_processes_where_joblib_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "CHUNK", 2)
    usual, done = run_sweep(DESIGN, RANGES, jobs=1), []
    used: list[int] = []

    def parallel(n_jobs: int) -> Any:
        used.append(n_jobs)
        return lambda tasks: [task() for task in tasks]

    joblib = SimpleNamespace(Parallel=parallel, delayed=lambda f: lambda *a: lambda: f(*a), __spec__=object())
    monkeypatch.setitem(sys.modules, "joblib", joblib)
    shared = run_sweep(DESIGN, RANGES, jobs=2, progress=done.append)
    assert used == [2, 2]
    assert done == [2, 4, 6]
    for key in report.KEYS:
        np.testing.assert_array_equal(usual.figures[key], shared.figures[key])
    np.testing.assert_array_equal(usual.pareto, shared.pareto)


def test_the_pareto_front_is_that_of_its_definition() -> None:
    generator = np.random.default_rng(3)
    for columns, rows in ((2, 60), (4, 120)):
        costs = generator.integers(0, 6, (rows, columns)).astype(float)  # with ties
        beaten = [any((other <= row).all() and (other < row).any() for other in costs) for row in costs]
        np.testing.assert_array_equal(pareto_front(costs), ~np.array(beaten))
    assert pareto_front(np.empty((0, 4))).shape == (0,)


def test_spreads_pass_into_the_figures_by_their_formulas() -> None:
    """d33 enters V/N as a factor: its spread is that of d33. A log-normal's logarithm is normal about the nominal."""
    spread = (("piezoelectric_coefficient", 0.1), ("bias_resistance", 0.3))
    result = run_tolerance(DESIGN, Tolerance(samples=500, spread=spread))
    for key, relative in (("volts_per_newton_gate", 0.1), ("leak_time_constant_s", 0.3)):
        logarithm = np.log(result.figures[key] / report.values(DESIGN, [key])[key])
        sigma = math.sqrt(math.log(1 + relative**2))
        assert np.std(logarithm) == pytest.approx(sigma, rel=5 / math.sqrt(2 * 500))
        assert abs(np.mean(logarithm)) <= 5 * sigma / math.sqrt(500)
    assert np.ptp(result.figures["film_capacitance_f"]) == 0


def test_the_offset_has_the_standard_deviation_of_pelgroms_law() -> None:
    design = replace(DESIGN, threshold_mismatch=20e-9, gain_mismatch=0.03e-6)
    result = run_tolerance(design, Tolerance(samples=500))
    pair, load = math.sqrt(3276e-6 * 12e-6), math.sqrt(160e-6 * 12e-6)
    amplifier = DESIGN.amplifier
    ratio = float(amplifier.load_transconductance / amplifier.input_transconductance)
    by_hand = math.hypot(
        20e-9 / pair / 0.58486,
        ratio * 20e-9 / load,
        0.5 * float(amplifier.overdrive) * 0.03e-6 / pair,
        0.5 * float(amplifier.overdrive) * 0.03e-6 / load,
    )
    assert np.std(result.figures[OFFSET]) == pytest.approx(by_hand, rel=0.16)
    # The tail current follows M5 against M6: gain, and threshold over half the overdrive.
    m5 = math.sqrt(80e-6 * 12e-6)
    overdrive = math.sqrt(2 * 200e-6 / (0.085 * 7.67363e-4 * 80 / 12))
    relative = math.hypot(0.03e-6 / m5, 2 * 20e-9 / m5 / overdrive)
    slew = result.figures["slew_hand_v_per_s"]
    assert np.std(slew) / np.mean(slew) == pytest.approx(relative, rel=0.35)


def test_the_currents_of_the_mirror_deviate_by_the_sizes_of_both_transistors() -> None:
    """M6 of a tenth of the width and current: its own deviation dominates, and is that of M5 and M8 alike."""
    design = replace(DESIGN, mirror_width=8e-6, reference_current=20e-6, threshold_mismatch=30e-9, load_resistance=1e12)
    result = run_tolerance(design, Tolerance(samples=1000))
    overdrive = math.sqrt(2 * 20e-6 / (0.085 * 7.67363e-4 * 8 / 12))

    def relative(width: float) -> float:
        return math.hypot(0.02e-6, 2 * 30e-9 / overdrive) / math.sqrt(2 * width * 12e-6)

    tail = np.log(result.figures["slew_hand_v_per_s"])
    assert np.std(tail) == pytest.approx(math.hypot(relative(80e-6), relative(8e-6)), rel=0.2)
    assert np.corrcoef(tail, result.figures["power_w"])[0, 1] == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("name", ["two_stage_59db_300khz", "one_stage_60db_1pf"])
def test_the_rms_of_the_common_mode_gain_is_that_of_the_hand_formula(name: str) -> None:
    """With mismatch so large that it matters."""
    design = replace(load_design(name).design, threshold_mismatch=500e-9, gain_mismatch=0.5e-6)
    result = run_tolerance(design, Tolerance(samples=400))
    hand = report.values(design, ["cmrr_systematic_db", "cmrr_hand_db"])
    assert hand["cmrr_hand_db"] < hand["cmrr_systematic_db"] - 0.5
    rms = -10 * math.log10(np.mean(10 ** (-result.figures[CMRR] / 10)))
    assert rms == pytest.approx(float(hand["cmrr_hand_db"]), abs=0.7)
    assert (np.diff(result.quantiles(CMRR)) > 0).all()


def test_without_mismatch_the_rejection_is_the_systematic_one() -> None:
    design = replace(DESIGN, threshold_mismatch=0.0, gain_mismatch=0.0)
    known = report.values(design, ["cmrr_systematic_db", "cmrr_hand_db", "offset_v"])
    result = run_tolerance(design, Tolerance(samples=3))
    assert result.figures[CMRR] == pytest.approx(float(known["cmrr_systematic_db"]), rel=1e-9)
    assert known["cmrr_hand_db"] == pytest.approx(float(known["cmrr_systematic_db"]), rel=1e-12)
    assert result.figures[OFFSET] == pytest.approx(float(known["offset_v"]), rel=1e-9)


def test_yield_and_quantiles_count_the_samples() -> None:
    limits = (Limit("gain_db", low=52.5), Limit("smallest_force_n", high=1.7e-4))
    result = run_tolerance(DESIGN, Tolerance(samples=200, spread=(("film_thickness", 0.1),), limits=limits))
    gain, force = result.figures["gain_db"], result.figures["smallest_force_n"]
    good = (gain >= 52.5) & (force <= 1.7e-4) & result.valid
    assert result.yielded == good.mean()
    assert 0 < result.yielded < 1
    assert result.passed["gain_db"].sum() == (gain >= 52.5).sum()
    ordered = np.sort(gain)
    for share, value in zip(QUANTILES, result.quantiles("gain_db"), strict=True):
        assert value == ordered[math.ceil(share * 200) - 1]
    lines = result.csv().splitlines()
    assert len(lines) == 201
    assert lines[0].split(",") == [*KEYS, "valid", "pass"]
    assert sum(int(line.rsplit(",", 1)[1]) for line in lines[1:]) == good.sum()


def test_the_seed_determines_the_samples() -> None:
    spread = (("film_area", 0.1),)
    first, again, other = (
        run_tolerance(DESIGN, Tolerance(samples=5, seed=seed, spread=spread)).csv() for seed in (1, 1, 2)
    )
    assert first == again != other


def test_a_design_that_never_works_has_no_yield() -> None:
    result = run_tolerance(PosfetDesign(supply=1.2), Tolerance(samples=3))
    assert result.yielded == 0
    assert np.isnan(result.quantiles("lowest_input_v")).all()
    with pytest.raises(ValueError, match="must be a single one"):
        run_tolerance(PosfetDesign(supply=np.array([5.0, 4.0])), Tolerance())
