# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the figures draw: dimensions of the drawings, recorded runs, errors against ngspice."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from support.paths import DOCS

pytest.importorskip("matplotlib", reason="the figures need matplotlib")

from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.device import paper
from posfet_model.figures import amplifier, design, layout, ngspice_runs, schematic, structure
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.ngspice import program

RUNS = DOCS / "figures"


def test_the_walls_of_the_etched_chip_are_crystal_planes() -> None:
    corners = structure.chip_outline()
    (outer, low), (inner, high) = corners[2], corners[3]
    assert math.degrees(math.atan2(high - low, outer - inner)) == pytest.approx(54.7356, abs=1e-4)
    assert high - low == pytest.approx(paper.WAFER_THICKNESS.value - structure.MEMBRANE_THICKNESS, abs=1e-15)
    assert corners[4] == (-inner, high)


def test_the_drawn_channel_has_the_width_of_table_i_and_fits_into_the_taxel() -> None:
    fingers = np.array(layout.channels())
    assert fingers[:, 3].sum() == pytest.approx(paper.CHANNEL_WIDTH.value, rel=1e-12)
    assert (fingers[:, 2] == paper.CHANNEL_LENGTH.value).all()
    half = math.sqrt(paper.FORCE_AREA.value) / 2
    assert (fingers[:, :2] > -half).all() and (fingers[:, :2] + fingers[:, 2:] < half).all()
    assert (np.diff(fingers[:, 0]) > paper.CHANNEL_LENGTH.value).all()


def test_the_schematic_has_the_sizes_of_table_ii() -> None:
    assert [schematic.size_label(name) for name in ("M1", "M7", "M8")] == ["M1\n3276/12", "M7\n240/12", "M8\n60/12"]


@pytest.mark.parametrize("name", ngspice_runs.FORCES)
def test_recorded_runs_are_those_of_the_device(name: str) -> None:
    """Their input is the gate voltage that the device model computes from the force."""
    time, v_in, _ = ngspice_runs.read(name, RUNS)
    force, stop = ngspice_runs.FORCES[name]
    fine, place = amplifier.fine_times(time, stop)
    gate = ngspice_runs.gate_voltage(force(fine), fine)[place]
    np.testing.assert_allclose(gate, v_in, rtol=0, atol=2e-5)
    assert np.ptp(gate) > 1.0


@pytest.mark.parametrize("name", ngspice_runs.FORCES)
def test_the_follower_from_a_force_agrees_with_ngspice(name: str) -> None:
    time, _, reference = ngspice_runs.read(name, RUNS)
    force, stop = ngspice_runs.FORCES[name]
    fine, place = amplifier.fine_times(time, stop)
    gate = ngspice_runs.gate_voltage(force(fine), fine)[place]
    limits = {"42.3 dB, 1.5 MHz": 1e-3, "sizes and bias": 1e-4}
    for knowledge, follower in amplifier.models().items():
        out = follower.run(time, gate).v_out
        error = np.abs((out - out[0]) - (reference - reference[0])).max() / np.ptp(reference)
        assert error < limits[knowledge], knowledge


@pytest.mark.parametrize("name", [*ngspice_runs.FAST_AMPLITUDES, *ngspice_runs.STEPPED])
def test_the_circuit_agrees_with_ngspice_where_it_slews_and_rings(name: str) -> None:
    time, v_in, reference = ngspice_runs.read(name, RUNS)
    bias = CIRCUITS[ngspice_runs.STEPPED.get(name, ngspice_runs.CIRCUIT)].bias
    output = CircuitFollower.from_design(bias).run(time, v_in)
    error = np.abs((output.v_out - output.v_out[0]) - (reference - reference[0])).max() / np.ptp(reference)
    assert error < 1e-3
    assert output.valid.all() == (name in {"fast_small", "step_10pf"})


def test_gain_and_phase_agree_with_ngspice() -> None:
    """Two numbers up to the unity crossing; sizes and bias up to 100 MHz."""
    for name in ("open_loop", "ac"):
        frequency, real, imaginary = ngspice_runs.read(name, RUNS)
        errors = {k: respond(frequency) / (real + 1j * imaginary) for k, respond in amplifier.responses(name).items()}
        assert np.abs(np.log(errors["sizes and bias"])).max() < 1e-4
        below = np.log(errors["42.3 dB, 1.5 MHz"])[frequency <= paper.GAIN_BANDWIDTH.value]
        assert np.abs(below).max() < 0.06  # 0.5 dB, 3.4 degrees


def test_a_charge_leaks_from_the_gate() -> None:
    time = np.linspace(0, 2.0, 201)
    gate = ngspice_runs.gate_voltage(np.where(time > 0, 1.0, 0.0), time)
    assert gate[0] == 0
    later = gate[1:] / gate[1]
    np.testing.assert_allclose(later, np.exp(-(time[1:] - time[1]) / paper.LEAK_TIME_CONSTANT.value), rtol=1e-9)


def test_design_curves_rise_or_fall_and_pass_through_the_default() -> None:
    rises = {"film thickness [µm]": True, "film area [mm²]": False, "permittivity [1]": False}
    for parameter in design.PARAMETERS:
        designs = parameter.design(parameter.values)
        assert (np.diff(designs.volts_per_newton()) > 0).all() == rises.get(parameter.name, True)
        assert np.isfinite(designs.smallest_force).all() and np.isfinite(designs.amplifier.gain_bandwidth).all()
        assert parameter.design(parameter.default).volts_per_newton() == pytest.approx(0.894, rel=2e-3)
        assert parameter.default in parameter.shown


def test_a_missing_run_is_reported_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"ngspice_press\.csv is missing; run from the root of the repository"):
        ngspice_runs.read("press", tmp_path)


@pytest.mark.spice
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")
def test_recording_again_gives_the_stored_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ngspice_runs.main(["--out", str(tmp_path)]) == 0
    written = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert sorted(path.name for path in written) == sorted(path.name for path in RUNS.glob("ngspice_*.csv"))
    for path in written:
        again, stored = (np.loadtxt(folder / path.name, delimiter=",", skiprows=2) for folder in (tmp_path, RUNS))
        if again.shape == stored.shape:  # another version of ngspice may choose other steps
            assert (np.abs(again - stored) <= 1e-3 * np.abs(stored).max(axis=0)).all(), path.name


def test_without_ngspice_recording_fails_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program, "PROGRAM", "no_such_program")
    assert ngspice_runs.main(["--out", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("ngspice_runs: ngspice is not on PATH")
