# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Designs adjusted to the figures that ngspice measured on another circuit: the follower is that circuit's."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model import design_command
from posfet_model.amplifier.calibration import calibrate_circuit
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import circuit_figures
from posfet_model.amplifier.input_findings import SLEW_RATE_NOT_GIVEN
from posfet_model.amplifier.operating_point import CIRCUIT_B
from posfet_model.amplifier.step_test import StepTest, slew_rates
from posfet_model.amplifier.transient_follower import CircuitFollower
from posfet_model.amplifier.undetermined import INPUTS_NOT_GIVEN, NEAR_REST, POLES_NOT_GIVEN
from posfet_model.config import ConfigError
from posfet_model.design import report
from posfet_model.design.design_file import FOLDER, load_design
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.ranges import BEYOND_KNOWN
from posfet_model.device.taxel_fields import FilmGeometry
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.recorded_runs import time_scale
from posfet_model.spice.stimuli import stimuli
from support.long_cases import long_cases
from support.spice_data import recorded
from support.sweep import assert_refused


@pytest.mark.parametrize(
    ("nominal", "real"),
    long_cases(
        [
            ("two_stage", "two_stage_100pf"),
            ("two_stage", "two_stage_half_cc"),
            ("one_stage", "one_stage_100pf"),
            ("one_stage", "one_stage_36db"),
        ],
        [("two_stage", "two_stage_half_cc"), ("one_stage", "one_stage_100pf")],
    ),
)
def test_the_adjusted_follower_is_the_measured_circuit_in_ngspice(nominal: str, real: str) -> None:
    record = recorded(real)
    seen = record.exact_loop
    design = load_design(nominal).design.with_measured(record.open_loop.gain, seen.unity_crossing, seen.phase_margin)
    exact = load_design(real).design
    for field in ("compensation", "load_capacitance"):
        assert getattr(design, field) == pytest.approx(getattr(exact, field), rel=0.02)
    inputs = stimuli(CIRCUITS[real], time_scale(record.loop))
    for name in ("up_50_mv", "down_50_mv"):
        time, v_in = inputs[name].resolved(150)
        wanted = np.interp(time, record.runs[name].time, record.runs[name].v_out)
        error = design.follower().run(time, v_in).v_out - wanted
        assert 100 * np.sqrt(np.mean(error**2)) / 0.05 <= 0.05


def simulated(design: str, circuit: str, run: str, folder: Path) -> float:
    """Return the rms error of `posfet design --simulate` against ngspice [% of full scale], of a text of a design."""
    record = recorded(circuit)
    time, v_in = stimuli(CIRCUITS[circuit], time_scale(record.loop))[run].resolved(80)
    rows = np.stack([time, v_in], axis=-1)
    (folder / "design.yaml").write_text(design, encoding="utf-8")
    np.savetxt(folder / "in.csv", rows, fmt="%.17g", delimiter=",", header="t,vin", comments="")
    words = [folder / "design.yaml", "--simulate", folder / "in.csv", "--out", folder / "out.csv"]
    with pytest.MonkeyPatch.context() as patch:  # overshoot and slew rates of the report are no part of a simulation
        patch.setattr(report, "step_test", lambda follower: StepTest(0.0, 0.0, 0.0))
        patch.setattr(report, "slew_rates", lambda *given: (1.0, 1.0))
        assert design_command.main([str(word) for word in words]) == 0
    found = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1)
    wanted = np.interp(found[:, 0], record.runs[run].time, record.runs[run].v_out)
    error = (found[:, 2] - found[0, 2] - wanted + wanted[0]) / np.ptp(wanted)
    square = 0.5 * (error[1:] ** 2 + error[:-1] ** 2) * np.diff(found[:, 0])
    return 100 * float(np.sqrt(square.sum() / found[-1, 0]))


def measured_text(circuit: str, *more: str) -> str:
    """Return the key `measured` with what ngspice shows of a circuit."""
    record = recorded(circuit)
    seen = record.exact_loop
    values = {
        "gain_db": record.open_loop.gain_db,
        "gbw_hz": seen.unity_crossing,
        "phase_margin_deg": seen.phase_margin,
        "bandwidth_hz": record.bandwidth,
        "slew_v_per_s": record.slew_rates[0],
        "falling_slew_v_per_s": record.slew_rates[1],
    }
    kept = ("gain_db", "gbw_hz", "phase_margin_deg", *more)
    return f"measured: {{{', '.join(f'{key}: {values[key]}' for key in kept)}}}\n"


@pytest.mark.parametrize(
    ("nominal", "real", "run"),
    long_cases(
        [
            ("two_stage", "two_stage_100pf", "down_1000_mv"),
            ("two_stage", "two_stage_half_cc", "up_1000_mv"),
            ("one_stage", "one_stage_100pf", "down_1000_mv"),
            ("one_stage", "one_stage_36db", "up_1000_mv"),
        ],
        [("two_stage", "two_stage_100pf", "down_1000_mv"), ("one_stage", "one_stage_36db", "up_1000_mv")],
    ),
)
def test_a_file_of_sizes_and_three_figures_slews_as_ngspice_does(
    nominal: str, real: str, run: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sizes = (FOLDER / f"{nominal}.yaml").read_text(encoding="utf-8")
    assert simulated(sizes + measured_text(real), real, run, tmp_path) <= 0.05
    assert "adjusted to the measured figures" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("nominal", "real", "more"),
    long_cases(
        [
            ("two_stage", "two_stage_small_rz_30pf", ("bandwidth_hz",)),
            ("one_stage", "one_stage_60db_1pf", ("slew_v_per_s", "falling_slew_v_per_s")),
        ],
        [("one_stage", "one_stage_60db_1pf", ("slew_v_per_s", "falling_slew_v_per_s"))],
    ),
)
def test_more_figures_make_up_for_a_bias_that_is_not_known(
    nominal: str, real: str, more: tuple[str, ...], tmp_path: Path
) -> None:
    sizes = (FOLDER / f"{nominal}.yaml").read_text(encoding="utf-8")
    assert simulated(sizes + measured_text(real, *more), real, "down_1000_mv", tmp_path) <= 0.05


@pytest.mark.parametrize("real", long_cases(["two_stage_half_cc", "one_stage_60db_1pf"], ["two_stage_half_cc"]))
def test_with_three_figures_alone_slow_inputs_are_valid_and_no_steps(
    real: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f"stages: {CIRCUITS[real].stages}\nfilm_geometry: as in paper\n" + measured_text(real)
    assert simulated(text, real, "press", tmp_path) <= 0.1
    shown = capsys.readouterr().out
    assert POLES_NOT_GIVEN not in shown and INPUTS_NOT_GIVEN in shown
    text = text.replace("}", ", lowest_input_v: -100 mV, highest_input_v: 1}")
    assert simulated(text, real, "press", tmp_path) <= 0.1
    assert "not valid for" not in capsys.readouterr().out
    assert simulated(text, real, "down_50_mv", tmp_path) <= 0.5
    shown = capsys.readouterr().out
    assert POLES_NOT_GIVEN in shown and SLEW_RATE_NOT_GIVEN not in shown
    simulated(text, real, "up_1000_mv", tmp_path)
    assert SLEW_RATE_NOT_GIVEN in capsys.readouterr().out
    design = load_design(str(tmp_path / "design.yaml")).design
    document = report.as_json(design)
    assert document["slew_v_per_s"] is document["slew_hand_v_per_s"] is document["falling_slew_v_per_s"] is None
    assert document["poles_known"] is document["slew_rate_known"] is False
    with pytest.raises(ValueError, match="second pole and zero"):
        design.linear_follower()


def test_with_figures_alone_what_is_valid_is_right_of_another_op_amp_with_the_same_figures() -> None:
    real = AmplifierCircuit.from_design(
        replace(CIRCUIT_B, zero_resistor=1200.0, compensation=1e-10, load_capacitance=1e-12)
    )
    seen = circuit_figures(real)
    three = float(seen.gain), float(seen.gain_bandwidth), float(seen.phase_margin)
    alone = PosfetDesign(
        film_geometry=FilmGeometry.AS_IN_PAPER, slew_rate_known=False, poles_known=False, known_inputs=(-0.3, 0.3)
    )
    follower = alone.with_measured(*three).follower()
    period = 1 / three[1]
    time = np.r_[0.0, np.linspace(0.5, 14.0, 400)] * period
    rise = np.clip(time / period - 0.5, 0.0, 0.015) / 0.015
    slow = np.linspace(0.0, 3e3, 301) * period
    for instants, volts in ((time, 0.05 * rise), (slow, 0.3 * np.sin(2 * np.pi * slow / (1e3 * period)))):
        wanted = CircuitFollower(circuit=real).run(instants, volts).v_out
        found = follower.run(instants, volts)
        error = 100 * np.abs(found.v_out - found.v_out[0] - wanted + wanted[0]) / np.ptp(wanted)
        assert found.valid.mean() > 0.5 and error[found.valid].max() <= 0.15
    step = follower.run(time, 0.05 * rise)
    wanted = CircuitFollower(circuit=real).run(time, 0.05 * rise).v_out
    assert np.abs(step.v_out - step.v_out[0] - wanted + wanted[0]).max() > 0.05 * 0.02  # and the rest is not
    assert step.reasons == [POLES_NOT_GIVEN]


@pytest.mark.parametrize(
    ("text", "known"), [("", False), ("reference_current: 200 uA\n", True), ("sink_width: 60 um\n", True)]
)
def test_sizes_and_bias_in_the_file_are_those_of_the_measured_op_amp(text: str, known: bool, tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    path.write_text(text + "measured: {gain_db: 52, gbw_hz: 5 MHz, phase_margin_deg: 70}\n", encoding="utf-8")
    design = load_design(str(path)).design
    assert design.slew_rate_known is known
    assert design.poles_known is known
    time = np.linspace(0, 1e-6, 51)
    step = design.follower().run(time, np.where(time > 1e-7, 1.0, 0.0))
    assert (SLEW_RATE_NOT_GIVEN in step.reasons) is not known
    assert (POLES_NOT_GIVEN in step.reasons) is not known


def test_a_slew_rate_may_have_its_usual_unit(tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    path.write_text(
        (FOLDER / "one_stage.yaml").read_text(encoding="utf-8")
        + "measured: {gain_db: 42.3, gbw_hz: 1.544 MHz, phase_margin_deg: 75.8, slew_v_per_s: 3 V/us}\n",
        encoding="utf-8",
    )
    loaded = load_design(str(path))
    rise, _ = slew_rates(loaded.design.follower())
    assert rise == pytest.approx(3e6, rel=2e-3)
    assert loaded.adjusted["reference_current"] < 100e-6


def test_slew_rates_of_a_file_are_refused_by_their_keys(tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    sizes = (FOLDER / "one_stage.yaml").read_text(encoding="utf-8")
    text = sizes + "measured: {gain_db: 42.3, gbw_hz: 1.544 MHz, phase_margin_deg: 75.8, slew_v_per_s: 3.2 V/us"
    path.write_text(text + ", falling_slew_v_per_s: 1 V/s}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"measured: slew_v_per_s and falling_slew_v_per_s must be reachable by the"):
        load_design(str(path))


def test_figures_alone_that_the_papers_op_amp_cannot_have_are_refused_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    text = "stages: 1\nmeasured: {gain_db: 47.5, gbw_hz: 4.94 MHz, phase_margin_deg: 76.2}\n"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"by load and compensation .* sizes and bias .* another film_geometry$"):
        load_design(str(path))
    path.write_text(f"{text}film_geometry: as in paper\n", encoding="utf-8")
    assert load_design(str(path)).design.amplifier.phase_margin == pytest.approx(76.2, abs=1e-3)


def test_no_answer_to_three_figures_is_right_of_all_op_amps_that_have_them() -> None:
    """Bias currents of 100 and 300 uA differ by 4.3 % on a step of 1 V: no answer is within 2 % of both."""
    three = 130.0, 1.5e6, 75.0
    period = 1 / three[1]
    time = np.r_[0.0, 1.5, np.linspace(1.515, 10.0, 600)] * period
    rise = np.clip(time / period - 1.5, 0.0, 0.015) / 0.015
    changes = []
    for current in (1e-4, 3e-4):
        nominal = AmplifierCircuit.from_design(replace(CIRCUIT_B, reference_current=current))
        circuit = calibrate_circuit(nominal, *three)
        found = circuit_figures(circuit)
        assert found.validity.valid
        assert (found.gain, found.gain_bandwidth, found.phase_margin) == pytest.approx(three, rel=1e-6)
        out = CircuitFollower(circuit=circuit).run(time, rise).v_out
        changes.append(out - out[0])
    apart = changes[0] - changes[1]
    square = 0.5 * (apart[1:] ** 2 + apart[:-1] ** 2) * np.diff(time)
    assert 100 * np.sqrt(square.sum() / time[-1]) > 2 * 2.0


MEASURED = "measured: {gain_db: 52, gbw_hz: 5 MHz, phase_margin_deg: 70"


def test_figures_alone_hold_at_the_inputs_that_were_seen_to_be_stable(tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    path.write_text(f"{MEASURED}}}\n", encoding="utf-8")
    design = load_design(str(path)).design
    assert design.known_inputs == NEAR_REST
    assert BEYOND_KNOWN in design.reasons
    assert design.largest_force == pytest.approx(NEAR_REST[1] / design.volts_per_newton())
    path.write_text(f"{MEASURED}, lowest_input_v: -0.2, highest_input_v: 950 mV}}\n", encoding="utf-8")
    design = load_design(str(path)).design
    assert design.known_inputs == (-0.2, 0.95)
    assert BEYOND_KNOWN not in design.reasons
    assert design.largest_force == pytest.approx(0.95 / design.volts_per_newton())
    inputs = np.array([-0.25, -0.15, 0.0, 0.9, 1.0])
    held = design.follower().start(0.0)
    slow = [design.follower().run([0.0, 1.0, 2.0], [volts, volts, volts]) for volts in inputs]
    assert [bool(run.valid.all()) for run in slow] == [False, True, True, True, False]
    assert bool(held.valid)
    known = PosfetDesign().with_measured(400.0, 5e6, 60.0)
    assert BEYOND_KNOWN not in known.reasons
    assert known.follower().run([0.0, 1.0], [0.5, 0.5]).reasons == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"sink_width: 60 um\n{MEASURED}, lowest_input_v: -1}}\n", "lowest_input_v: must be left out with sizes"),
        (f"{MEASURED}, lowest_input_v: 0.1}}\n", "lowest_input_v: must not exclude 0 V"),
        (f"{MEASURED}, highest_input_v: -0.1}}\n", "highest_input_v: must not exclude 0 V"),
        (f"{MEASURED}, highest_input_v: 5 kV}}\n", "highest_input_v: must be of a magnitude in"),
    ],
)
def test_a_range_of_inputs_that_cannot_be_is_refused_by_its_key(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        load_design(str(path))
    with pytest.raises(ValueError, match="known_inputs"):
        PosfetDesign(known_inputs=(0.1, 1.0))
    with pytest.raises(ValueError, match="known_inputs must be a tuple"):
        CircuitFollower(known_inputs=0.1)  # type: ignore[arg-type]


def test_what_is_refused() -> None:
    good = {"gain": 400.0, "gain_bandwidth": 5e6, "phase_margin": 60.0}
    design = PosfetDesign()
    assert_refused(design.with_measured, {**good, "gain": 1e6}, "gain")
    assert_refused(design.with_measured, {**good, "gain_bandwidth": 0.0}, "gain_bandwidth")
    assert_refused(design.with_measured, {**good, "phase_margin": 180.0}, "phase_margin")
    assert_refused(design.with_measured, {**good, "bandwidth": 0.0}, "bandwidth")
    assert_refused(design.with_measured, {**good, "slew_rate": -1.0}, "slew_rate")
    assert_refused(design.with_measured, {**good, "falling_slew_rate": 1e6}, "slew_rate")
    assert_refused(PosfetDesign(stages=1).with_measured, {**good, "bandwidth": 5e6}, "bandwidth")
    with pytest.raises(ValueError, match=r"must be a single one, got arrays of shape \(2,\)"):
        PosfetDesign(supply=np.array([4.0, 5.0])).with_measured(**good)
