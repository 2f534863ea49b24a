"""The comparison of models with the set of circuits: what is measured, what counts as missed, and the command."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model import spice_compare
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.amplifier.open_loop import OpenLoop
from posfet_model.spice import circuit_comparison, random_designs
from posfet_model.spice.circuit_comparison import Comparison, LoopError, RunError, compare, step_target
from posfet_model.spice.circuit_models import CircuitModel
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.comparison_table import table
from posfet_model.spice.measurement import LoopMeasurement
from posfet_model.spice.random_designs import Verdict, confusion_table
from posfet_model.spice.recorded_runs import Record, RecordedRun, time_scale
from posfet_model.spice.stimuli import stimuli
from support.spice_data import FOLDER, recorded

needs_ngspice = pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")

GAIN, CROSSING = 200.0, 1.5e6


def one_pole(scale: float = 1.0) -> CircuitModel:
    """Return a follower of one pole, with the bandwidth scaled."""
    pole = scale * CROSSING / math.sqrt(GAIN**2 - 1)
    closed = OnePoleFollower(gain=GAIN / (1 + GAIN), bandwidth=pole * (1 + GAIN))
    return CircuitModel(closed, OpenLoop(GAIN, (pole, math.inf)))


def record_of(model: CircuitModel) -> Record:
    """Return a record as if ngspice had run the model itself."""
    loop = LoopMeasurement(GAIN, CROSSING / GAIN, CROSSING, float(model.open_loop.phase_margin))
    runs = {}
    for name, what in stimuli(CIRCUITS["one_stage"], time_scale(loop)).items():
        time, volts = what.resolved(4001)
        runs[name] = RecordedRun(time, model.follower.run(time, volts).v_out, 0.0)
    return replace(recorded("one_stage"), loop=loop, runs=runs)


def compared(monkeypatch: pytest.MonkeyPatch, truth: CircuitModel, model: CircuitModel) -> Comparison:
    monkeypatch.setattr(circuit_comparison, "WAYS", {"sizes": lambda circuit, loop, point: model})
    return compare(CIRCUITS["one_stage"], record_of(truth), "sizes")


def test_a_model_compared_with_itself_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    found = compared(monkeypatch, one_pole(), one_pole())
    assert len(found.runs) == 14
    assert max(run.max_pct for run in found.runs) < 0.05  # straight lines between samples of the record
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
    unstable = replace(record_of(one_pole()), loop=LoopMeasurement(GAIN, CROSSING / GAIN, CROSSING, -5.0))
    monkeypatch.setattr(circuit_comparison, "WAYS", {"sizes": lambda circuit, loop, point: one_pole()})
    found = compare(CIRCUITS["one_stage"], unstable, "sizes")
    assert found.runs == ()
    assert set(found.wrongly_valid) == set(unstable.runs)
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


def test_the_table_names_each_miss_once() -> None:
    found = [compare(CIRCUITS[name], recorded(name), "sizes") for name in ("one_stage", "two_stage_no_rz_unstable")]
    text = table(found)
    for part in found:
        for miss in part.misses():
            assert text.count(f"{part.loop.circuit}, sizes: {miss}") == 1
    assert "unstable: no run to compare" in text


def test_the_command_prints_json_and_fails_on_a_missed_target(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    options = [
        "circuits",
        "--recorded",
        str(FOLDER / "circuits"),
        "--circuit",
        "one_stage",
        "--model",
        "sizes",
        "--json",
    ]
    code = spice_compare.main(options)
    found = json.loads(capsys.readouterr().out)
    assert [part["circuit"] for part in found] == ["one_stage"]
    assert len(found[0]["runs"]) == 14
    assert code == int(bool(found[0]["misses"]))
    monkeypatch.setattr(circuit_comparison, "SLOW_TARGET", 1e-9)
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
