# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet design`: report, JSON, netlist, simulation, sweep and tolerances; one line for anything wrong."""

from __future__ import annotations

import json
import math
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posfet.cli import COMMANDS
from posfet_model import design_command
from posfet_model.amplifier.step_test import StepTest
from posfet_model.design import report, simulation
from posfet_model.design.design_file import shipped
from posfet_model.design.posfet_design import PosfetDesign

STEP = "t,vin\n0,0\n1e-6,0\n1e-6,0.05\n3e-6,0.05\n"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(*words: Any) -> tuple[int, str, str]:
        code = design_command.main([str(word) for word in words])
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.fixture
def without_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Overshoot and slew rates are integrated for single designs, which other tests do: here their place is taken."""
    monkeypatch.setattr(report, "step_test", lambda follower: StepTest(0.0, 0.0, 0.0))
    monkeypatch.setattr(report, "slew_rates", lambda *given: (1.0, 1.0))


def test_the_report_has_every_figure_with_its_unit(run: Any) -> None:
    code, out, err = run("square_millimetre")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    keys = [figure.key for figure in report.REPORT]
    assert [line.split()[0] for line in lines[: len(keys)]] == keys
    assert "coupling                               0.5849  share of a voltage" in out
    assert "gain_db                               52.5 dB  open-loop gain" in out
    assert lines[len(keys)] == "valid"
    assert "not valid: unstable" in run("two_stage_thin_film_unstable")[1]


def test_json_has_the_promised_keys_and_null_for_what_is_unknown(run: Any) -> None:
    document = json.loads(run("two_stage", "--json")[1])
    promised = ("gain_db", "gbw_hz", "phase_margin_deg", "overshoot_pct", "slew_v_per_s")
    figures = {figure.key for figure in report.REPORT}
    assert set(document) == {
        "valid",
        "stable",
        "reasons",
        "stages",
        "slew_rate_known",
        "poles_known",
        "film_geometry",
        *figures,
    }
    assert figures == {"overshoot_pct", "slew_v_per_s", "falling_slew_v_per_s", *report.KEYS}
    assert all(isinstance(document[key], float) for key in promised)
    assert document["stable"] is document["valid"] is True
    assert document["reasons"] == []
    # Of ngspice on the same step; the hand formulas give 4.49 and 2.88 V/us.
    assert document["slew_v_per_s"] == pytest.approx(4.7925e6, rel=1e-3)
    assert document["falling_slew_v_per_s"] == pytest.approx(3.4243e6, rel=1e-3)
    assert document["slew_hand_v_per_s"] == pytest.approx(4.49e6, rel=2e-3)
    assert document["gain_db"] == pytest.approx(42.4, abs=0.2)
    unstable = json.loads(run("two_stage_no_rz_unstable", "--json")[1])
    assert unstable["stable"] is unstable["valid"] is False
    assert unstable["settling_time_s"] is unstable["overshoot_pct"] is unstable["slew_v_per_s"] is None
    assert unstable["reasons"][0].startswith("unstable")


def test_the_report_says_what_was_adjusted_to_measured_figures(run: Any, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("measured: {gain_db: 52, gbw_hz: 5 MHz, phase_margin_deg: 60}\n", encoding="utf-8")
    last = run(path)[1].splitlines()[-1]
    names = ("compensation", "load_capacitance", "load_resistance")
    document = json.loads(run(path, "--json")[1])
    assert set(document["adjusted"]) == set(names)
    units = dict(zip(names, ("F", "F", "ohm"), strict=True))
    shown = (f"{name} {report.readable(document['adjusted'][name], units[name])}" for name in names)
    assert last == f"adjusted to the measured figures: {', '.join(shown)}"
    wanted = {"gain_db": 52, "gbw_hz": 5e6, "phase_margin_deg": 60}
    assert {key: document[key] for key in wanted} == pytest.approx(wanted, rel=1e-5)


def test_figures_in_round_numbers_are_reached(run: Any, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    for text in (
        "{gain_db: 42.3, gbw_hz: 1.0 MHz, phase_margin_deg: 54}",
        "{gain_db: 40, gbw_hz: 1e6, phase_margin_deg: 50}",
    ):
        path.write_text(f"stages: 2\nmeasured: {text}\n", encoding="utf-8")
        assert json.loads(run(path, "--json")[1])["gbw_hz"] == pytest.approx(1e6, rel=1e-6)


@pytest.mark.usefixtures("without_steps")
def test_a_long_oscillation_is_announced(run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text(STEP, encoding="utf-8")
    words = ("two_stage_thin_film_unstable", "--simulate", source, "--out", out)
    assert run(*words)[2] == ""
    monkeypatch.setattr(design_command, "LONG_OSCILLATION", 1.0)
    assert run(*words)[2].startswith("posfet design: unstable: some 1e+01 periods of oscillation")
    assert run(*words, "--linear")[2] == ""


@pytest.mark.usefixtures("without_steps")
def test_every_shipped_design_has_a_report(run: Any) -> None:
    assert run("--list")[1].split() == shipped()
    for name in shipped():
        code, out, err = run(name, "--json")
        assert (code, err) == (0, ""), name
        document = json.loads(out)
        assert document["valid"] == (document["reasons"] == []), name


@pytest.mark.usefixtures("without_steps")
def test_the_netlist_is_written(run: Any, tmp_path: Path) -> None:
    assert run("one_stage", "--netlist", tmp_path / "a.cir")[0] == 0
    text = (tmp_path / "a.cir").read_text(encoding="utf-8")
    assert text.startswith("* One stage with POSFET inputs")
    assert text.splitlines()[0].endswith(": one_stage")
    assert text.endswith(".ends opamp\n")
    (tmp_path / "my finger-1.yaml").write_text("stages: 2\n", encoding="utf-8")
    assert run(tmp_path / "my finger-1.yaml", "--netlist", tmp_path / "b.cir")[0] == 0
    assert (tmp_path / "b.cir").read_text(encoding="utf-8").splitlines()[0].endswith(": my_finger_1")


@pytest.mark.usefixtures("without_steps")
def test_a_simulation_has_the_inputs_own_times_or_even_ones(run: Any, tmp_path: Path) -> None:
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text(f"# a step\n{STEP}", encoding="utf-8")
    code, text, _ = run("two_stage", "--simulate", source, "--out", out)
    assert code == 0
    assert text.splitlines()[-1] == f"{out}: 4 samples, the model is valid for 4 of them"
    assert out.read_text(encoding="utf-8").splitlines()[0] == "t,vin,vout"
    own = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(own[:, :2], [[0, 0], [1e-6, 0], [1e-6, 0.05], [3e-6, 0.05]])
    # At rest the output follows but for the finite gain.
    gain = json.loads(run("two_stage", "--json")[1])["follower_gain"]
    assert own[-1, 2] - own[0, 2] == pytest.approx(0.05 * gain, rel=1e-4)
    assert json.loads(run("two_stage", "--simulate", source, "--out", out, "--dt", "1e-7", "--json")[1])[
        "simulation"
    ] == {"samples": 31, "valid_samples": 31, "reasons": []}
    even = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(even[:, 0], np.arange(31) * 1e-7, rtol=1e-12)
    np.testing.assert_array_equal(even[:, 1], np.where(np.arange(31) >= 10, 0.05, 0.0))
    # The jump is not smeared over a step: the response to it at 1.1 us is that of a finer run.
    run("two_stage", "--simulate", source, "--out", out, "--dt", "1e-8")
    fine = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(fine[::10, 2], even[:, 2], atol=1e-5)  # the error bound of the integration
    assert 0.01 < even[11, 2] < 0.04


@pytest.mark.usefixtures("without_steps")
def test_a_simulation_says_which_samples_are_not_valid_and_why(run: Any, tmp_path: Path) -> None:
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text("t,vin\n0,0\n1e-5,-0.5\n1.5e-5,-1.28\n1.6e-5,-1.28\n4e-5,0.5\n6e-5,0.5\n", encoding="utf-8")
    code, text, _ = run("square_millimetre", "--simulate", source, "--out", out)
    assert code == 0
    lines = text.splitlines()
    place = lines.index(f"{out}: 6 samples, the model is valid for 4 of them")
    assert lines[place + 1] == "  not valid for 2, first at 1.5e-05 s: unstable at this input: the follower oscillates"
    reasons = json.loads(run("square_millimetre", "--simulate", source, "--out", out, "--json")[1])["simulation"]
    assert reasons["reasons"][0] == {
        "reason": "unstable at this input: the follower oscillates",
        "samples": 2,
        "first_time_s": 1.5e-5,
    }
    # Samples between the wanted ones do not count.
    even = json.loads(run("square_millimetre", "--simulate", source, "--out", out, "--dt", "6e-5", "--json")[1])
    assert even["simulation"] == {"samples": 2, "valid_samples": 2, "reasons": []}
    linear = json.loads(run("square_millimetre", "--simulate", source, "--out", out, "--linear", "--json")[1])
    assert [one["reason"] for one in linear["simulation"]["reasons"]] == ["the input is beyond the limits of the model"]
    assert linear["simulation"]["reasons"][0]["samples"] == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: header must be t,vin, got nothing"),
        ("time,v\n0,0\n", ":1: header must be t,vin, got 'time,v'"),
        ("t,vin\n", ":1: must have at least one row below the header"),
        ("t,vin\n0,0\n1,2,3\n", ":3: must be 2 values (t,vin), got 3"),
        ("t,vin\n0,0\n# x\n1,volt\n", ":4: vin must be a number in [-1e+06, 1e+06], got 'volt'"),
        ("t,vin\n0,0\n1,nan\n", ":3: vin must be a number in [-1e+06, 1e+06], got 'nan'"),
        ("t,vin\n0,0\n1_0,0\n", ":3: t must be a number in [-1e+12, 1e+12], got '1_0'"),
        ("t,vin\n0,0\n2,0\n\n1,0\n", ":5: t must not decrease, got 1 after 2"),
    ],
)
def test_a_bad_signal_is_refused_with_its_row(run: Any, tmp_path: Path, text: str, message: str) -> None:
    source = tmp_path / "in.csv"
    source.write_text(text, encoding="utf-8")
    code, out, err = run("two_stage", "--simulate", source, "--out", tmp_path / "out.csv")
    assert (code, out) == (1, "")
    assert err == f"posfet design: {source}{message}\n"
    assert not (tmp_path / "out.csv").exists()


def test_a_sweep_writes_a_table_and_names_the_front(run: Any, tmp_path: Path) -> None:
    file, table = tmp_path / "mine.yaml", tmp_path / "s.csv"
    file.write_text("sweep: {field: film_area, from: 0.5 mm2, to: 4 mm2, points: 5, log: true}\n", encoding="utf-8")
    code, out, _ = run(file, "--sweep", table, "--jobs", 1)
    assert code == 0
    rows = table.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 6
    assert "5 designs, 5 valid, 5 on the Pareto front of snr_db, bandwidth_hz, power_w, area_m2" in out
    document = json.loads(run(file, "--sweep", table, "--jobs", 1, "--json")[1])["sweep"]
    assert (document["designs"], document["valid"]) == (5, 5)
    best = document["pareto_front"][0]
    assert best["film_area"] == pytest.approx(0.5e-6)  # the smallest film has the highest voltage
    assert best["snr_db"] == pytest.approx(float(PosfetDesign(film_area=0.5e-6).signal_to_noise), rel=1e-6)


def test_a_plot_of_the_front_is_drawn(run: Any, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    file, table, plot = tmp_path / "mine.yaml", tmp_path / "s.csv", tmp_path / "s.svg"
    file.write_text("sweep: {field: supply, from: 1.2, to: 5, points: 3}\n", encoding="utf-8")
    assert run(file, "--sweep", table, "--plot", plot)[0] == 0
    first = plot.read_bytes()
    assert b"<svg" in first
    assert run(file, "--sweep", table, "--plot", plot)[0] == 0
    assert plot.read_bytes() == first
    table.unlink()
    code, _, err = run(file, "--sweep", table, "--plot", tmp_path / "s.txt")
    assert code == 1
    assert err.endswith("the name of a plot must end in .svg, .png, .pdf\n")
    assert not table.exists()  # said before anything is computed


def test_a_sweep_without_a_valid_design_says_why(run: Any, tmp_path: Path) -> None:
    file, table = tmp_path / "mine.yaml", tmp_path / "s.csv"
    file.write_text("sweep: {field: supply, from: 0.6, to: 1, points: 3}\n", encoding="utf-8")
    code, out, _ = run(file, "--sweep", table, "--jobs", 1)
    assert code == 0
    assert "3 designs, 0 valid" in out
    assert out.splitlines()[-1].endswith("not valid: " + PosfetDesign(supply=0.6).reasons[-1])


@pytest.mark.parametrize(
    ("text", "option", "message"),
    [
        (
            "sweep: {field: remnant_polarisation, from: 1 uC/cm2, to: 6 uC/cm2, points: 3}",
            "--sweep",
            "sweep: remnant_polarisation must be below saturation_polarisation",
        ),
        (
            "tolerance: {samples: 200, spread: {remnant_polarisation: 60 %}}",
            "--tolerance",
            "tolerance: of a random sample, remnant_polarisation must be below saturation_polarisation",
        ),
    ],
)
def test_designs_that_contradict_themselves_are_said_with_the_key_of_the_file(
    run: Any, tmp_path: Path, text: str, option: str, message: str
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    code, out, err = run(file, option, tmp_path / "x.csv")
    assert (code, out) == (1, "")
    assert err.startswith(f"posfet design: {file}: {message}")
    assert err.count("\n") == 1


def test_tolerances_are_printed_with_quantiles_and_yield(run: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(
        "tolerance: {samples: 20, spread: {film_area: 10 %}, limits: {gain_db: {min: 60}}}\n", encoding="utf-8"
    )
    code, out, _ = run(file, "--tolerance", tmp_path / "t.csv")
    assert code == 0
    assert "20 samples, 20 valid, yield 0.0 %" in out
    assert "  gain_db: 0.0 % within the limit" in out
    document = json.loads(run(file, "--tolerance", tmp_path / "t.csv", "--json")[1])["tolerance"]
    assert (document["samples"], document["yield"], document["limits"]) == (20, 0, {"gain_db": 0})
    assert math.isfinite(document["quantiles"]["offset_v"]["0.5"])
    assert len((tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()) == 21


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give the path of a design file, or the name of a shipped one (--list)"),
        (
            ["nothing"],
            "nothing: no such design; give the path of a YAML file or a shipped design (listed by ",
        ),
        (["none/x.yaml"], "none/x.yaml: no such design file"),
        (["two_stage", "--simulate", "in.csv"], "--simulate and --out must be given together"),
        (["two_stage", "--dt", "1e-6"], "--dt needs --simulate"),
        (["two_stage", "--linear"], "--linear needs --simulate"),
        (["two_stage", "--plot", "x.svg"], "--plot needs --sweep"),
        (["two_stage", "--sweep", "x.csv"], "two_stage: sweep: missing, must be a range or a list of ranges"),
        ([""], "give the path of a design file, or the name of a shipped one (--list)"),
        (["two_stage", "--netlist", "/nowhere/x.cir"], "--netlist: /nowhere/x.cir: there is no such folder; make it"),
        (["two_stage", "--tolerance", "/"], "--tolerance: / is a folder; give the name of a file"),
        (
            ["two_stage", "--simulate", "a.csv", "--out", "./a.csv"],
            "--out: a.csv is the input of --simulate, too; give another name",
        ),
        (["a.yaml", "--netlist", "a.yaml"], "--netlist: a.yaml is the design file, too; give another name"),
        (
            ["two_stage", "--sweep", "a.csv", "--tolerance", "a.csv"],
            "--tolerance: a.csv is the file of --sweep, too; give another name",
        ),
        (["two_stage", "--simulate", "/nowhere/in.csv", "--out", "x.csv"], "/nowhere/in.csv: cannot be read: "),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(run: Any, words: list[str], message: str) -> None:
    code, out, err = run(*words)
    assert (code, out) == (1, "")
    assert err.startswith(f"posfet design: {message}")
    assert err.count("\n") == 1


@pytest.mark.parametrize("words", [["--dt", "0"], ["--dt", "fast"], ["--jobs", "0"], ["--jobs", "1.5"]])
def test_a_bad_option_is_a_usage_error(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        design_command.main(["two_stage", *words])
    assert caught.value.code == 2
    assert words[0] in capsys.readouterr().err


@pytest.mark.usefixtures("without_steps")
@pytest.mark.parametrize("words", [(), ("--dt", "1e-8")])
def test_times_may_be_unix_times_to_the_nanosecond(words: tuple[str, ...], run: Any, tmp_path: Path) -> None:
    """In float64 a Unix time is 0.24 us off, twice the time constant of the follower."""
    times = ("0", "0.000001", "0.00000101", "0.000001375", "0.0000025")
    outs = []
    for start in ("", "170000000"):
        rows = [f"{start}{time},{volts}" for time, volts in zip(times, (0, 0, 0.05, 0.05, 0.05), strict=True)]
        source, out = tmp_path / "in.csv", tmp_path / "out.csv"
        source.write_text("\n".join(["t,vin", *rows, ""]), encoding="utf-8")
        shown = run("two_stage_100pf", "--simulate", source, "--out", out, "--json", *words)[1]
        cells = [line.split(",") for line in out.read_text(encoding="utf-8").splitlines()[1:]]
        since = [float(Decimal(cell[0]) - Decimal(start + "0")) for cell in cells]
        outs.append((since, [cell[1:] for cell in cells]))
        reasons = json.loads(shown)["simulation"]["reasons"]
        assert reasons[0]["first_time_s"] == pytest.approx(float(start + "0"))
    assert outs[0][0] == pytest.approx(outs[1][0], abs=1e-18)
    assert outs[0][1] == outs[1][1]
    assert len(set(outs[1][0])) == len(outs[1][0]) == (len(times) if not words else 251)


def test_times_that_decrease_are_shown_as_they_are_written(run: Any, tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    source.write_text("t,vin\n1700000000.000002,0\n1700000000.000001,0\n", encoding="utf-8")
    code, _, err = run("two_stage", "--simulate", source, "--out", tmp_path / "out.csv")
    assert code == 1
    assert "in.csv:3: t must not decrease, got 1700000000.000001 after 1700000000.000002" in err


@pytest.mark.usefixtures("without_steps")
def test_small_signals_may_be_simulated_by_the_linear_follower(run: Any, tmp_path: Path) -> None:
    source, outputs = tmp_path / "in.csv", []
    source.write_text("t,vin\n0,0\n1e-6,0\n1e-6,0.002\n3e-6,0.002\n", encoding="utf-8")
    for words in ((), ("--linear",)):
        out = tmp_path / "out.csv"
        assert run("two_stage_100pf", "--simulate", source, "--out", out, "--dt", "1e-8", *words)[0] == 0
        outputs.append(np.loadtxt(out, delimiter=",", skiprows=1)[:, 2])
    circuit, linear = outputs
    assert np.abs(circuit - linear).max() <= 0.06 * 0.002  # the circuit has more than two poles
    assert linear.max() - linear[-1] > 0.1 * 0.002  # it rings
    source.write_text(STEP.replace("0.05", "1"), encoding="utf-8")
    words = ("two_stage", "--simulate", source, "--out", tmp_path / "out.csv", "--dt", "1e-8", "--linear", "--json")
    steep = json.loads(run(*words)[1])["simulation"]
    assert 0 < steep["valid_samples"] < steep["samples"] == 301


@pytest.mark.usefixtures("without_steps")
def test_a_long_signal_is_followed_in_pieces_without_a_seam(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, out = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_text(STEP, encoding="utf-8")
    results = []
    for piece in (1000, 7):
        monkeypatch.setattr(simulation, "PIECE", piece)
        run("two_stage", "--simulate", source, "--out", out, "--dt", "1e-7", "--linear")
        results.append(np.loadtxt(out, delimiter=",", skiprows=1))
    np.testing.assert_allclose(results[0], results[1], rtol=0, atol=1e-12)


@pytest.mark.usefixtures("without_steps")
def test_an_unstable_design_is_not_simulated_as_valid(run: Any, tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    source.write_text(STEP, encoding="utf-8")
    words = ("two_stage_thin_film_unstable", "--simulate", source, "--out", tmp_path / "out.csv", "--json")
    assert json.loads(run(*words)[1])["simulation"]["valid_samples"] == 0


def test_the_umbrella_knows_the_command() -> None:
    assert COMMANDS["design"][0] == "posfet_model.design_command"
