# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The command that compares any follower run with the models: its output, and its errors for invalid files."""

import json
import math
import re
import subprocess
import sys
import time
from dataclasses import astuple
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

import posfet_model
from posfet_model import spice_compare
from posfet_model.amplifier.closed_loop import ClosedLoop
from posfet_model.amplifier.follower import OnePoleFollower, SquareLawFollower
from posfet_model.amplifier.slew_identification import slew_model
from posfet_model.device.paper import AMPLIFIER_GAIN
from posfet_model.spice.model_comparison import deviation, fit_overdrive
from posfet_model.spice.ngspice import CIRCUITS, closed_loop
from posfet_model.spice.run_file import FollowerRun, read_run
from support.spice_data import path, small_signal

ONE_POLE_RATIO = 1 + 1 / AMPLIFIER_GAIN.value
"""Ratio of the bandwidth of a one-pole follower to the gain-bandwidth product of its op-amp."""

MODELS = {"ideal", "static", "one_pole", "two_pole", "square_law_slew"}


def write(file: Path, *columns: np.ndarray, head: str = "time,v_in,v_out") -> Path:
    np.savetxt(file, np.c_[columns], delimiter=",", header=head, comments="", fmt="%.15g")
    return file


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = spice_compare.main([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def test_without_gain_and_bandwidth_only_uncalibrated_models_are_compared(capsys) -> None:
    code, out, err = command(capsys, path("opamp_b", "tap"))
    printed = json.loads(out)
    assert (code, err, set(printed)) == (0, "", MODELS)
    for result in printed.values():
        assert set(result) == {"blind"}
        assert set(result["blind"]) == {"max_pct", "rms_pct"}
        assert 0 < result["blind"]["rms_pct"] < result["blind"]["max_pct"] < 1


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_the_command_as_users_run_it(circuit: str) -> None:
    loop = closed_loop(small_signal(circuit, "ac"))
    options = [path(circuit, "tap"), "--gain", f"{loop.gain:.6f}", "--bandwidth", f"{loop.bandwidth:.0f}"]
    done = subprocess.run(
        [sys.executable, "-m", "posfet_model.spice_compare", *options],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(posfet_model.__file__).parents[1],
    )
    printed = json.loads(done.stdout)
    assert set(printed) == MODELS
    for name in ("one_pole", "two_pole", "square_law_slew"):
        assert printed[name]["blind"]["max_pct"] <= 0.25
        assert printed[name]["calibrated"]["max_pct"] <= 0.05


def test_a_run_of_the_model_itself_is_reproduced_exactly(tmp_path: Path) -> None:
    generator = np.random.default_rng(11)
    instants = np.cumsum(10 ** generator.uniform(-9, -6, 3000))
    v_in = np.repeat(generator.normal(size=30), 100)
    file = tmp_path / "run.csv"
    one = OnePoleFollower(gain=0.97, bandwidth=2e6, offset=0.3)
    write(file, instants, v_in, one.run(instants, v_in).v_out)
    assert spice_compare.compare(file, 0.97, 2e6)["one_pole"]["calibrated"]["max_pct"] <= 1e-8
    slewing = SquareLawFollower(gain=0.97, bandwidth=2e6, overdrive=0.123)
    write(file, instants, v_in, slewing.run(instants, v_in).v_out)
    product = 2e6 / ONE_POLE_RATIO
    seen = 2.4e6  # measured with a second pole; the lag is that of the gain-bandwidth product
    compared = spice_compare.compare(file, 0.97, seen, gain_bandwidth=product, overdrive=0.123)
    assert compared["square_law_slew"]["calibrated"]["max_pct"] <= 1e-8
    model = slew_model(ClosedLoop(0.97, seen), product)
    assert fit_overdrive(read_run(file), model) == pytest.approx(0.123, abs=1e-3)


def test_percentages_refer_to_peak_to_peak_and_rms_is_over_time() -> None:
    instants = np.array([0.0, 1.0, 2.0, 10.0])
    v_out = np.array([0.5, 2.5, 0.5, 0.5])  # full scale 2 V
    result = deviation(FollowerRun(instants, np.full(4, 7.0), v_out), OnePoleFollower(gain=1.0, bandwidth=1e3))
    assert result.max_pct == pytest.approx(100, abs=1e-12)
    assert result.rms_pct == pytest.approx(100 * math.sqrt((0.5 + 0.5) / 10), abs=1e-12)


def test_the_smallest_swing_accepted_prints_json(tmp_path: Path, capsys) -> None:
    file = write(tmp_path / "run.csv", np.array([0.0, 1e-300, 1.0]), np.array([0.0, 1e6, 1e6]), np.array([0, 1e-3, 0]))
    code, out, err = command(capsys, file)
    assert (code, err) == (0, "")
    for result in json.loads(out, parse_constant=pytest.fail).values():
        assert np.isfinite(list(result["blind"].values())).all()


def test_a_value_that_json_cannot_represent_is_reported_in_one_line(capsys, monkeypatch) -> None:
    monkeypatch.setattr(spice_compare, "compare", lambda *_, **__: {"ideal": {"blind": {"max_pct": math.inf}}})
    code, out, err = command(capsys, path("opamp_b", "tap"))
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "must be finite" in err


@pytest.mark.parametrize(
    ("gain", "noted"), [("42.3", True), ("10", True), ("60", True), ("61", False), ("0.99", False)]
)
def test_a_gain_that_looks_like_decibels_is_noted_apart_from_the_json(capsys, gain: str, noted: bool) -> None:
    code, out, err = command(capsys, path("opamp_b", "tap"), "--gain", gain, "--bandwidth", "1.5e6", "--overdrive", "1")
    assert code == 0
    assert set(json.loads(out)) == MODELS
    assert err.count("\n") == 1 + noted
    if noted:
        a0 = float(gain)
        assert f"--gain {a0:g} is read as an open-loop gain in V/V, not dB" in err
        assert f"{a0 / (1 + a0):.6g} V/V" in err


@pytest.mark.parametrize(
    ("circuit", "stages", "said"),
    [
        ("opamp_b", 2, "two stages; overdrive 0.4664 V, by hand formulas"),
        ("opamp_c", 1, "one stage and an output follower; overdrive 0.3214 V, by hand formulas"),
        ("opamp_b", None, "one pole; overdrive 0.39 V, assumed"),
    ],
)
def test_the_assumed_op_amp_is_noted_apart_from_the_json(capsys, circuit, stages, said) -> None:
    loop = closed_loop(small_signal(circuit, "ac"))
    options = ["--gain", loop.gain, "--bandwidth", loop.bandwidth, *([] if stages is None else ["--stages", stages])]
    code, out, err = command(capsys, path(circuit, "step"), *options)
    assert (code, set(json.loads(out))) == (0, MODELS)
    assert err == f"spice_compare: square_law_slew, calibrated: {said}\n"


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_nothing_is_fitted_to_the_evaluated_run(circuit: str, monkeypatch) -> None:
    """The calibrated model does not depend on the output of the run: only the error changes."""
    loop, run = closed_loop(small_signal(circuit, "ac")), read_run(path(circuit, "step"))
    seen = []
    monkeypatch.setattr(spice_compare, "deviations", lambda run, models: seen.append(models) or {})
    monkeypatch.setattr(spice_compare, "read_run", lambda file: run)
    spice_compare.compare(path(circuit, "step"), *astuple(loop))
    run = FollowerRun(run.time, run.v_in, 0.5 * run.v_out[::-1])
    spice_compare.compare(path(circuit, "step"), *astuple(loop))
    first, second = seen[1]["square_law_slew"], seen[3]["square_law_slew"]
    assert (first.gain, first.bandwidth, first.overdrive, first.lead) == (
        second.gain,
        second.bandwidth,
        second.overdrive,
        second.lead,
    )


def test_the_overdrive_can_be_measured_on_another_run(tmp_path: Path, capsys) -> None:
    generator = np.random.default_rng(14)
    loop = ["--gain", "0.97", "--bandwidth", "2.4e6", "--gain-bandwidth", f"{2e6 / ONE_POLE_RATIO:.17g}"]
    slewing = SquareLawFollower(gain=0.97, bandwidth=2e6, overdrive=0.2)
    files = []
    for name in ("judged", "other"):
        instants = np.cumsum(10 ** generator.uniform(-9, -6, 2000))
        v_in = np.repeat(generator.normal(size=20), 100)
        files.append(write(tmp_path / f"{name}.csv", instants, v_in, slewing.run(instants, v_in).v_out))
    code, out, err = command(capsys, files[0], *loop, "--overdrive-from", files[1])
    assert (code, "measured on other.csv" in err) == (0, True)
    assert json.loads(out)["square_law_slew"]["calibrated"]["max_pct"] <= 0.05
    for other, reason in (
        (files[0], "another run than the one that is compared"),
        (path("opamp_b", "press"), "must be a run that slews"),
        (tmp_path / "none.csv", "cannot be read"),
    ):
        code, out, err = command(capsys, files[0], *loop, "--overdrive-from", other)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert reason in err


def test_an_open_loop_gain_is_converted_to_its_closed_loop_gain() -> None:
    file = path("opamp_b", "tap")
    assert spice_compare.compare(file, 130.0, 1.4e6) == spice_compare.compare(file, 130 / 131, 1.4e6)


def test_comments_blank_lines_and_jumps_are_read(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_bytes(
        b"\xef\xbb\xbf# made by hand\r\n\r\n time, v_in ,v_out\r\n0,0,0\r\n# in between\r\n"
        b"1e-9,0,0\r\n1e-9,1,0\r\n 2E-9 ,+1,.01\r\n\r\n"
    )
    run = read_run(file)
    np.testing.assert_array_equal(run.time, [0, 1e-9, 1e-9, 2e-9])
    np.testing.assert_array_equal(run.v_in, [0, 0, 1, 1])
    assert np.isfinite(list(spice_compare.compare(file)["two_pole"]["blind"].values())).all()


def test_unix_time_is_read_to_the_picosecond(tmp_path: Path) -> None:
    """In float64 it has steps of 0.24 us, two time constants of the follower."""
    first = path("opamp_b", "step")
    begin, *rows = [line for line in first.read_text().splitlines() if not line.startswith("#")]
    shifted = [f"{Decimal('1763836800.125') + Decimal(t)},{v}" for t, _, v in (row.partition(",") for row in rows)]
    file = tmp_path / "unix.csv"
    file.write_text("\n".join([begin, *shifted]))
    run = read_run(file)
    np.testing.assert_array_equal(run.time, read_run(first).time)
    assert spice_compare.compare(file) == spice_compare.compare(first)


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("", 1, "header must be time,v_in,v_out, got nothing"),
        ("# only\n# comments\n", 1, "header must be"),
        ("0,0,0\n1,1,1\n", 1, "header must be time,v_in,v_out, got '0,0,0'"),
        ("# x\ntime;v_in;v_out\n0;0;0\n", 2, "header must be"),
        ("time,v_in,v_out\n", 1, "at least 2 rows, got 0"),
        ("time,v_in,v_out\n0,0,0\n", 2, "at least 2 rows, got 1"),
        ("time,v_in,v_out\n0,0,0\n# x\n1,1\n", 4, r"3 values .* expected, got 2"),
        ("time,v_in,v_out\n0,0,0\n1,1,1,1\n", 3, "3 values .* expected, got 4"),
        ("time,v_in,v_out\n0,0,0,0\n1,1,1,1\n", 2, "3 values .* expected, got 4"),
        ("time,v_in,v_out\n0,0,0\n1,volt,1\n", 3, "v_in must be a number, got 'volt'"),
        ("time,v_in,v_out\n0,0,0\n1,,1\n", 3, "v_in must be a number, got ''"),
        ("time,v_in,v_out\n0,0,0\n1,1,nan\n", 3, r"v_out must be in \[-1e\+06, 1e\+06\], got nan"),
        ("time,v_in,v_out\n0,0,0\n1,inf,1\n", 3, "v_in must be in .*, got inf"),
        ("time,v_in,v_out\n0,0,0\n1,1e7,1\n", 3, "v_in must be in .*, got 1e"),
        ("time,v_in,v_out\n0,0,0\n1e300,1,1\n", 3, "time must be in .*, got 1e"),
        ("time,v_in,v_out\n0,0,0\n2,1,1\n\n1,1,1\n", 5, "time must not decrease, got a step of -1 s"),
        ("time,v_in,v_out\n3,0,0\n3,1,1\n", 3, "time must increase"),
        ("time,v_in,v_out\n0,0,5\n1,1,5\n", 3, "v_out must vary by 5e-09 V or more, got 0 V"),
        ("time,v_in,v_out\n0,0,0\n1,1,1e-310\n", 3, "v_out must vary by 1e-09 V or more, got 1e-310 V"),
        ("time,v_in,v_out\n0,0,0\n1,1e-310,1e-310\n", 3, "v_out must vary by 1e-12 V or more, got 1e-310 V"),
        ("time,v_in,v_out\n0,1e6,1\n1,1e6,1.0009\n", 3, "v_out must vary by 0.001 V or more, got 0.0009 V"),
        ("time,v_in,v_out\n0,0,0\n1_0,1,1\n", 3, "time must be a number"),
        ("time,v_in,v_out\n1e-9,0,0\n1e-99999999999999999999,1,1\n", 3, "time must be a number"),
        ("time,v_in,v_out\n-1e10,0,0\n1e10,1,1\n", 3, r"steps must be at most 1e\+09 s"),
    ],
)
def test_an_invalid_file_is_reported_in_one_line(tmp_path: Path, capsys, text: str, line: int, reason: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    code, out, err = command(capsys, file)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith(f"spice_compare: {file}:{line}: ")
    assert re.search(reason, err)


def test_an_unreadable_file_is_reported_in_one_line(tmp_path: Path, capsys) -> None:
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00time")
    for file in (tmp_path / "none.csv", tmp_path, tmp_path / "binary.csv"):
        code, out, err = command(capsys, file)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert err.startswith(f"spice_compare: {file}: cannot be read")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--gain", "0.99"], "must be given together"),
        (["--bandwidth", "1e6"], "must be given together"),
        (["--gain", "3", "--bandwidth", "1e6"], "--gain must be in"),
        (["--gain", "0", "--bandwidth", "1e6"], "--gain must be in"),
        (["--gain=-1", "--bandwidth", "1e6"], "--gain must be in"),
        (["--gain", "nan", "--bandwidth", "1e6"], "--gain must be in"),
        (["--gain", "inf", "--bandwidth", "1e6"], "--gain must be in"),
        (["--gain", "0.99", "--bandwidth", "0"], "--bandwidth must be in"),
        (["--gain", "0.99", "--bandwidth=-1e6"], "--bandwidth must be in"),
        (["--gain", "0.99", "--bandwidth", "nan"], "--bandwidth must be in"),
        (["--overdrive", "0.3"], "need --gain and --bandwidth"),
        (["--overdrive-from", "x.csv"], "need --gain and --bandwidth"),
        (["--gain-bandwidth", "1e6"], "need --gain and --bandwidth"),
        (["--gain", "0.99", "--bandwidth", "1e6", "--gain-bandwidth", "0"], "--gain-bandwidth must be in"),
        (
            ["--gain", "0.99", "--bandwidth", "1e6", "--overdrive", "1", "--overdrive-from", "x.csv"],
            "cannot be combined",
        ),
        (["--gain", "0.99", "--bandwidth", "1e6", "--overdrive", "0"], "--overdrive must be in"),
    ],
)
def test_invalid_options_are_reported_in_one_line(capsys, options: list[str], reason: str) -> None:
    code, out, err = command(capsys, path("opamp_b", "tap"), *options)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert reason in err


@pytest.mark.parametrize("options", [[], ["x.csv", "--gain", "much"], ["x.csv", "--speed"]])
def test_a_wrong_command_line_is_reported_in_one_line(capsys, options: list[str]) -> None:
    with pytest.raises(SystemExit) as left:
        spice_compare.main(options)
    assert left.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_help_explains_gain_and_bandwidth(capsys) -> None:
    with pytest.raises(SystemExit) as left:
        spice_compare.main(["--help"])
    assert left.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in ("steady state", "gain of the follower at low frequency", "-3 dB bandwidth", "peak-to-peak"):
        assert words in text


def test_a_hundred_thousand_uneven_rows_take_less_time_than_a_loop(tmp_path: Path) -> None:
    generator = np.random.default_rng(12)
    instants = np.cumsum(10 ** generator.uniform(-9, -6, 100_000))
    v_in = np.sin(2 * np.pi * 2e4 * instants)
    run = FollowerRun(instants, v_in, 0.99 * v_in)
    follower = OnePoleFollower(gain=0.99, bandwidth=1.5e6)
    begin = time.perf_counter()
    deviation(run, follower)
    whole = time.perf_counter() - begin
    state = follower.start(v_in[0])
    begin = time.perf_counter()
    for k in range(1, 2000):
        state = follower.advance(state, v_in[k], instants[k] - instants[k - 1])
    assert whole < 50 * (time.perf_counter() - begin)
