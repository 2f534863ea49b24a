# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Runs of ngspice: a failed, incomplete or too coarse one is an error, and so is a missing program."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from posfet_model.spice import ngspice, reference_runs
from posfet_model.spice.ngspice import transient as ngspice_transient
from support.sweep import NOT_REAL_NUMBERS, assert_refused


@pytest.mark.spice
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")
class TestErrors:
    def test_a_rejected_circuit_is_an_error(self) -> None:
        with pytest.raises(ngspice.SpiceError, match="ngspice failed"):
            ngspice.run_follower(
                ".subckt opamp plus minus out\nm1 out plus 0 0 nomodel\n.ends", "sin(0 1 1k)", 1e-3, 1e-5
            )

    def test_an_aborted_run_is_an_error(self) -> None:
        chatter = "cx out 0 1f\nbout out 0 i=v(out)>v(plus)*(time>5e-4) ? 1e6 : -1e6\nrx out 0 1g\nrm minus plus 1k"
        with pytest.raises(ngspice.SpiceError, match=r"ngspice failed|stopped at"):
            ngspice.run_follower(f".subckt opamp plus minus out\n{chatter}\n.ends", "sin(0 1 1k)", 1e-3, 1e-5)

    def test_a_run_too_coarse_for_its_output_is_an_error(self) -> None:
        wire = ".subckt opamp plus minus out\nrwire plus out 1\nrload out 0 1meg\n.ends"
        with pytest.raises(ngspice.SpiceError, match="coarse"):
            ngspice.run_follower(wire, "sin(0 1 1k)", 1e-3, 5e-5)


class TestWithoutNgspice:
    @pytest.fixture(autouse=True)
    def _no_program(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("PATH", str(tmp_path))

    def test_missing_ngspice_is_reported(self, tmp_path: Path, capsys) -> None:
        assert not ngspice.available()
        with pytest.raises(ngspice.SpiceError, match="not on PATH"):
            ngspice.run_follower(ngspice.netlist("opamp_b"), "sin(0 1 1k)", 1e-3, 1e-6)
        assert reference_runs.main([str(tmp_path / "new")]) == 1
        assert capsys.readouterr().err.startswith("reference_runs: ngspice is not on PATH")

    @pytest.mark.parametrize(
        ("script", "reason"),
        [
            ("echo 'doAnalyses: TRAN:  Timestep too small'", "too small"),
            ("exit 3", "status 3"),
            ("true", "no output"),
            ("printf 'Title: x\\nBinary:\\n' > out.raw", "malformed header"),
            ("printf 'Flags: real\\nNo. Variables: 3\\nNo. Points: 9\\nBinary:\\nabc' > out.raw", "ends before its 9"),
            (
                "printf 'Flags: complex\\nNo. Variables: 3\\nNo. Points: 9\\nBinary:\\n' > out.raw",
                "not of the requested analysis",
            ),
        ],
    )
    def test_a_run_that_failed_is_an_error(self, tmp_path: Path, monkeypatch, script: str, reason: str) -> None:
        program = tmp_path / "ngspice"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
        with pytest.raises(ngspice.SpiceError, match=reason):
            ngspice.run_follower(ngspice.netlist("opamp_b"), "sin(0 1 1k)", 1e-3, 1e-6)


def raw(time: np.ndarray, v_out: np.ndarray) -> bytes:
    head = f"Title: follower\nFlags: real\nNo. Variables: 3\nNo. Points: {time.size}\nBinary:\n"
    return head.encode() + np.c_[time, v_out, v_out].tobytes()


@pytest.mark.parametrize(
    ("time", "v_out", "reason"),
    [
        (np.linspace(0, 0.5e-3, 501), np.linspace(0, 1, 501), "stopped at 0.0005 s of 0.001 s"),
        (np.linspace(0, 1e-3, 101), np.linspace(0, 1, 101), "steps range"),
        (np.linspace(0, 1e-3, 1001), np.linspace(0, 1, 1001) > 0.5, "coarse"),
        (np.linspace(0, 1e-3, 1001), np.full(1001, math.nan), "not finite"),
    ],
)
def test_an_incomplete_or_invalid_run_is_an_error(monkeypatch, time, v_out, reason: str) -> None:
    content = raw(time, v_out.astype(float))
    monkeypatch.setattr(
        ngspice_transient,
        "simulate",
        lambda deck, complex_values: ngspice.read_raw(content, complex_values=complex_values),
    )
    with pytest.raises(ngspice.SpiceError, match=reason):
        ngspice.run_follower("", "sin(0 1 1k)", 1e-3, 1.01e-6)


def test_a_gain_that_never_falls_has_no_bandwidth() -> None:
    flat = ngspice.SmallSignal(frequency=np.array([1.0, 10.0]), transfer=np.array([1.0 + 0j, 0.9]))
    with pytest.raises(ngspice.SpiceError, match="does not fall"):
        ngspice.closed_loop(flat)


def test_invalid_arguments_are_rejected_by_name() -> None:
    assert_refused(ngspice.netlist, {"circuit": "opamp_z"}, "circuit")
    assert_refused(ngspice.piecewise_linear, {"time": [0, 1], "volts": [0]}, "volts")
    for time in ([1, 2], [0, 0], [0, -1]):
        assert_refused(ngspice.piecewise_linear, {"time": time, "volts": [0, 1]}, "time")
    good = {"circuit": "", "source": "", "stop": 1.0, "largest_step": 1e-3}
    for value in (0.0, -1.0, *NOT_REAL_NUMBERS):
        assert_refused(ngspice.run_follower, {**good, "stop": value}, "stop")
        assert_refused(ngspice.run_follower, {**good, "largest_step": value}, "largest_step")
    assert_refused(ngspice.run_follower, {**good, "largest_step": 0.1}, "largest_step")
    assert_refused(ngspice.run_follower_ac, {"circuit": "", "lowest": 0.0}, "lowest")
    assert_refused(ngspice.run_open_loop_ac, {"circuit": "", "lowest": 1.0, "highest": 2.0}, "highest")
