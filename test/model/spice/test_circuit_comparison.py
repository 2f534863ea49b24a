# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The comparison of models with the set of circuits: what is measured, what counts as missed, and the command."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model import spice_compare
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.spice import circuit_command, circuit_comparison, random_designs
from posfet_model.spice.circuit_comparison import Comparison, LoopError, RunError, compare, step_target
from posfet_model.spice.circuit_models import WAYS, CircuitModel, extracted
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.comparison_table import table
from posfet_model.spice.measurement import LoopMeasurement
from posfet_model.spice.random_designs import Verdict, confusion_table
from posfet_model.spice.record_file import Record, RecordedRun
from posfet_model.spice.recorded_runs import time_scale
from posfet_model.spice.stimuli import stimuli
from support.long_cases import long_cases
from support.spice_data import FOLDER, recorded

needs_ngspice = pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")

GAIN, CROSSING = 200.0, 1.5e6


def one_pole(scale: float = 1.0) -> CircuitModel:
    """Return a follower of one pole, with the bandwidth scaled."""
    pole = scale * CROSSING / math.sqrt(GAIN**2 - 1)
    closed = OnePoleFollower(gain=GAIN / (1 + GAIN), bandwidth=pole * (1 + GAIN))
    op_amp = OpenLoop(GAIN, (pole, math.inf))
    return CircuitModel(
        follower=closed,
        gain=GAIN,
        closed_loop_gain=closed.gain,
        unity_crossing=float(op_amp.gain_bandwidth),
        phase_margin=float(op_amp.phase_margin),
        stable=True,
        usable=True,
    )


def record_of(model: CircuitModel) -> Record:
    """Return a record as if ngspice had run the model itself."""
    loop = LoopMeasurement(GAIN, CROSSING / GAIN, CROSSING, model.phase_margin)
    runs = {}
    for name, what in stimuli(CIRCUITS["one_stage"], time_scale(loop)).items():
        time, volts = what.resolved(4001)
        runs[name] = RecordedRun(time, model.follower.run(time, volts).v_out, 0.0)
    return replace(recorded("one_stage"), loop=loop, exact_loop=loop, runs=runs)


def brief(name: str, *runs: str) -> Record:
    """Return a recorded circuit with few of its runs."""
    whole = recorded(name)
    kept = {run: whole.runs[run] for run in runs or ("up_50_mv",) if run in whole.runs}
    return replace(whole, runs=kept, unstable=whole.unstable[:1])


def compared(monkeypatch: pytest.MonkeyPatch, truth: CircuitModel, model: CircuitModel) -> Comparison:
    monkeypatch.setattr(circuit_comparison, "WAYS", {"sizes": lambda circuit, record: model})
    return compare(CIRCUITS["one_stage"], record_of(truth), "sizes")


def test_a_model_compared_with_itself_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    found = compared(monkeypatch, one_pole(), one_pole())
    assert len(found.runs) == 14
    assert max(run.max_pct for run in found.runs) < 0.1  # straight lines between samples of the record
    assert all(run.valid for run in found.runs)
    assert found.misses() == []


def test_a_wrong_bandwidth_misses_and_the_numbers_are_right(monkeypatch: pytest.MonkeyPatch) -> None:
    found = compared(monkeypatch, one_pole(), one_pole(0.5))
    assert found.loop.errors()["unity_crossing"] == pytest.approx(-50, abs=0.1)
    by_name = {run.stimulus: run for run in found.runs}
    # exp(-t/T) - exp(-t/2T): at most 1/4; squared, over all times T/6, T = 1/(2 pi 1.5 MHz), in a window of 9.515/f.
    step = by_name["up_50_mv"]
    assert step.max_pct == pytest.approx(25, abs=0.5)
    window = stimuli(CIRCUITS["one_stage"], CROSSING)["up_50_mv"].stop
    assert step.rms_pct == pytest.approx(100 * math.sqrt(1 / (2 * math.pi * CROSSING) / 6 / window), rel=0.05)
    assert not step.met
    assert by_name["press"].met
    assert any("unity crossing -50" in miss for miss in found.misses())
    assert any(miss.startswith("up_50_mv rms") for miss in found.misses())


def test_an_unstable_circuit_must_be_named_so_and_never_be_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    names = tuple(record_of(one_pole()).runs)
    loop = LoopMeasurement(GAIN, CROSSING / GAIN, CROSSING, -5.0)
    unstable = replace(recorded("one_stage"), loop=loop, exact_loop=loop, runs={}, unstable=names)
    monkeypatch.setattr(circuit_comparison, "WAYS", {"sizes": lambda circuit, record: one_pole()})
    found = compare(CIRCUITS["one_stage"], unstable, "sizes")
    assert found.runs == ()
    assert found.wrongly_valid == names
    assert "is unstable, the model says stable" in found.misses()


@pytest.mark.parametrize(
    ("way", "volts", "target"),
    [("sizes", 0.01, 1.0), ("sizes", 0.05, 1.0), ("sizes", 1.0, 1.5), ("given", 0.05, 0.5), ("given", 1.0, 0.5)],
)
def test_targets(way: str, volts: float, target: float) -> None:
    assert step_target(way, volts) == target


def test_an_error_that_is_not_a_number_is_a_miss() -> None:
    run = RunError("c", "sizes", "press", math.nan, math.nan, 0.1, 0.0, valid=True)
    assert not run.met
    nothing = (math.nan, math.nan)
    loop = LoopError("c", "sizes", (40, 40), (1e6, math.nan), (60, 60), nothing, nothing, (True, True), (True, True))
    missed = Comparison(loop, (run,), ()).misses()
    assert [miss.split()[0] for miss in missed] == ["unity", "overshoot", "press"]
    assert "nan*" in table([Comparison(loop, (run,), ())])


def test_the_table_names_each_miss_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(circuit_comparison, "STEP_TARGETS", {"given": (1e-3, 1e-3)})
    found = [compare(CIRCUITS[name], brief(name), "given") for name in ("two_stage", "two_stage_no_rz_unstable")]
    assert any(part.misses() for part in found)
    text = table(found)
    for part in found:
        for miss in part.misses():
            assert text.count(f"{part.loop.circuit}, given: {miss}") == 1
    assert "unstable: no run to compare" in text


def test_the_command_prints_json_and_fails_on_a_missed_target(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(circuit_command, "load", lambda file: brief(file.stem))
    options = [
        "circuits",
        "--recorded",
        str(FOLDER / "circuits"),
        "--circuit",
        "one_stage",
        "--model",
        "given",
        "--json",
    ]
    code = spice_compare.main(options)
    found = json.loads(capsys.readouterr().out)
    assert [part["circuit"] for part in found] == ["one_stage"]
    assert [run["stimulus"] for run in found[0]["runs"]] == ["up_50_mv"]
    assert (code, found[0]["misses"]) == (0, [])
    monkeypatch.setattr(circuit_comparison, "STEP_TARGETS", {"given": (1e-9, 1e-9)})
    assert spice_compare.main(options) == 1


def test_missing_recorded_runs_are_reported_in_one_line(tmp_path: Path, capsys) -> None:
    assert spice_compare.main(["circuits", "--recorded", str(tmp_path), "--circuit", "one_stage"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("spice_compare: ")
    assert err.count("\n") == 1


def test_the_command_prints_a_netlist(capsys) -> None:
    assert spice_compare.main(["netlist", "one_stage_36db"]) == 0
    assert capsys.readouterr().out.startswith("* One stage")


def test_the_confusion_table_counts_verdicts() -> None:
    def one(spice: str, model: str, margin: float) -> Verdict:
        return Verdict(CIRCUITS["one_stage"], spice, model, (margin, margin + 2), (1e6, 1.05e6), oscillates=False)

    text = confusion_table([one("usable", "usable", 80.0), one("unstable", "not usable", -3.0)])
    assert "stability differs on 1, usability on 0" in text
    assert "one_stage: -3.0 / -1.0 degrees" in text


@pytest.mark.parametrize("way", ["sizes", "calibrated", "operating_point"])
@pytest.mark.parametrize("name", CIRCUITS)
def test_the_circuit_models_name_margin_crossing_and_stability(name: str, way: str) -> None:
    """On all circuits; in time on some below, and on all inputs by `spice_compare circuits`."""
    found = compare(CIRCUITS[name], replace(recorded(name), runs={}, unstable=()), way).loop
    assert found.stable[0] == found.stable[1]
    assert found.gain_db[1] == pytest.approx(found.gain_db[0], abs=0.1)
    if found.stable[0]:
        errors = found.errors()
        assert abs(errors["phase_margin"]) <= 1
        assert abs(errors["unity_crossing"]) <= 10


@pytest.mark.parametrize(
    ("name", "run"),
    [
        ("two_stage_300pf", "down_1000_mv"),
        ("one_stage_10mhz", "up_1000_mv"),
    ],
)
def test_the_circuit_from_sizes_runs_as_ngspice_does(name: str, run: str) -> None:
    """Slewing on either side, ringing, cut off: 0.02 % rms of full scale, where 0.1 to 1.5 % are allowed."""
    (found,) = compare(CIRCUITS[name], brief(name, run), "sizes").runs
    assert found.rms_pct <= 0.02


@pytest.mark.parametrize("name", long_cases(["one_stage_60db_1pf", "two_stage_small_rz_30pf"], ["one_stage_60db_1pf"]))
def test_measured_figures_and_the_papers_sizes_run_as_ngspice_does(name: str) -> None:
    """Bias and Rz of these circuits are not the paper's; the figures give them."""
    (found,) = compare(CIRCUITS[name], brief(name, "down_1000_mv"), "measured").runs
    assert found.rms_pct <= 0.1
    assert found.target_pct == 0.5


def test_no_run_of_an_unstable_circuit_is_valid() -> None:
    for name in ("two_stage_thin_film_unstable", "two_stage_no_zero_resistor"):
        record = replace(recorded(name), runs={})
        assert record.unstable
        for way in set(WAYS) - {"measured"}:  # which takes seconds to find the op-amp
            assert compare(CIRCUITS[name], record, way).wrongly_valid == ()


@pytest.mark.parametrize("way", ["given", pytest.param("measured", marks=pytest.mark.slow)])
def test_figures_at_0_v_are_not_valid_at_inputs_where_no_range_of_stability_was_seen(way: str) -> None:
    """81 degrees at 0 V, and unstable at the lowest input of two sines."""
    name = "two_stage_wide_output_50ua_30pf"
    record = recorded(name)
    assert {"sine_1000_hz", "sine_10000_hz"} == set(record.unstable)
    kept = {run: record.runs[run] for run in ("press", "up_1000_mv")}
    found = compare(CIRCUITS[name], replace(record, runs=kept), way)
    assert found.wrongly_valid == ()
    by_name = {run.stimulus: run for run in found.runs}
    assert by_name["press"].valid and by_name["press"].met


def test_transistors_extracted_from_an_operating_point_are_those_of_the_sizes() -> None:
    circuit = CIRCUITS["two_stage_thin_film_unstable"]
    found = extracted(circuit, recorded(circuit.name).bias_point)
    sizes = AmplifierCircuit.from_design(circuit.bias, circuit.design, circuit.stages)
    for name in ("beta", "gate_area", "threshold", "modulation", "reference_current"):
        np.testing.assert_allclose(getattr(found, name), getattr(sizes, name), rtol=2e-3)


@pytest.mark.spice
@needs_ngspice
def test_the_stability_of_random_designs(capsys) -> None:
    """A few designs of the command's; the long run is `spice_compare random --count 200`."""
    assert spice_compare.main(["random", "--count", "4", "--seed", "3"]) == 0
    assert capsys.readouterr().out.splitlines()[4].startswith("4 designs; stability differs on 0")


def test_random_designs_are_the_same_for_a_seed() -> None:
    one, other = (
        [random_designs.random_circuit(np.random.default_rng(5), number) for number in range(4)] for _ in range(2)
    )
    assert one == other
    assert [circuit.stages for circuit in one] == [2, 1, 2, 1]
