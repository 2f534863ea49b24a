# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The benchmarks run, and their results are stored, compared with targets and reported."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rich", reason="the tables of the benchmarks need rich")

from benchmarks import __main__ as command
from benchmarks import report
from benchmarks.outcome import Chart, Outcome, Table
from benchmarks.simulation import follower_against_ngspice
from benchmarks.targets import TARGETS, Target
from posfet_driver.bus.slcan_codec import encode_line
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.spice import ngspice

NEED = {"latency": "rclpy", "ordinary": "rclpy", "sustained": "rclpy", "startup": "rclpy", "web": "rclpy",
        "skipped": "posfet_msgs", "labelling": "scipy",
        "decode": "cantools", "decode_mapped": "cantools"}  # fmt: skip


def test_an_outcome_survives_a_round_trip(tmp_path: Path) -> None:
    chart = Chart("front", "Front", "time", "error", {"method": [(1.0, 2.0, "a point")]})
    outcome = Outcome({"name_us": 1.25}, [Table("Title", ("a", "b"), [("x", 1)], "note")], [chart])
    outcome.write(tmp_path / "outcome.json")
    read = Outcome.read(tmp_path / "outcome.json")
    assert read.values == outcome.values
    assert report.results({}, {"one": read}, {}, False) == report.results({}, {"one": outcome}, {}, False)


def test_results_list_every_target_and_every_failure() -> None:
    text = report.results({"commit": "abc"}, {"start": Outcome({"startup_s": 0.75})}, {"slcan": "too slow"}, False)
    for target in TARGETS:
        assert f"| {target.name} |" in text
    assert "| 0.75 | pass |" in text
    assert "Failed: too slow" in text


@pytest.mark.parametrize(
    ("value", "verdict"), [(90.0, "stretch"), (100.0, "stretch"), (101.0, "pass"), (251.0, "short")]
)
def test_verdict_compares_the_value_with_both_limits(value: float, verdict: str) -> None:
    assert Target("name", "what", (250.0, 100.0)).verdict(value) == verdict
    assert Target("name", "what", (-250.0, -100.0), at_least=True).verdict(-value) == verdict


def test_every_subject_can_be_loaded() -> None:
    for name in command.SUBJECTS:
        if name in NEED:
            try:
                import_module(NEED[name])
            except ImportError:
                continue
        assert callable(import_module(f"benchmarks.{command.SUBJECTS[name][0]}").measure), name


def test_a_benchmark_without_its_tool_is_skipped_naming_the_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--only", "sim_vs_ngspice"])
    assert command.main() == 0
    output = " ".join(capsys.readouterr().out.split())
    assert "skipped: ngspice is not on PATH. Install with: sudo apt-get install ngspice" in output
    assert "s; skipped: sim_vs_ngspice; failed: none" in output
    skipped = {"sim_vs_ngspice": follower_against_ngspice.measure(False)}
    text = report.results({}, skipped, {}, False)
    assert "| - | skipped: ngspice is not on PATH. Install with: sudo apt-get install ngspice |" in text
    assert "## sim_vs_ngspice\n\nSkipped: ngspice is not on PATH." in text
    assert follower_against_ngspice.main() == 0


def test_a_reference_with_a_different_input_is_rejected() -> None:
    time = np.linspace(0, 200e-6, 401)
    driven = follower_against_ngspice.sine(time, 0.05)
    same = ngspice.Transient(time, driven, driven)
    assert follower_against_ngspice.error_percent(same, 0.05, time, driven) == 0.0
    with pytest.raises(RuntimeError, match=r"different inputs: 0\.2 V apart with a sine of 0\.25 V"):
        follower_against_ngspice.error_percent(same, 0.25, time, follower_against_ngspice.sine(time, 0.25))
    with pytest.raises(RuntimeError, match="different inputs: nan V"):
        follower_against_ngspice.check_same_input(ngspice.Transient(time, driven * np.nan, driven), 0.05)


@pytest.mark.spice
@pytest.mark.skipif(not ngspice.available(), reason="needs ngspice")
def test_ngspice_and_the_model_get_the_same_input() -> None:
    _, last = follower_against_ngspice.ngspice_run([0.05, 0.25], 200)
    follower_against_ngspice.check_same_input(last, 0.25)
    assert follower_against_ngspice.array_error(last, 0.25) < 0.1  # one pole for the circuit: 0.07 %
    with pytest.raises(RuntimeError, match="different inputs"):
        follower_against_ngspice.array_error(last, 0.05)


def test_times_are_compared_with_the_echo_of_the_same_run() -> None:
    end_to_end = pytest.importorskip("benchmarks.latency.end_to_end", reason="needs rclpy")
    rig = pytest.importorskip("benchmarks.latency.rig")
    touched, idle, echo = (
        rig.Measurement(np.linspace(0.0, 2.0 * latency, 101), np.full(9, ready), cpu, 0, 0, 0)
        for latency, ready, cpu in ((300.0, 200.0, 30.0), (250.0, 150.0, 20.0), (200.0, 100.0, 10.0))
    )
    assert end_to_end.over_echo(touched, idle, echo) == pytest.approx(
        {
            "ready_touched_over_echo": 2.0,
            "ready_idle_over_echo": 1.5,
            "latency_p50_over_echo": 1.5,
            "latency_p99_over_echo": 1.5,
            "cpu_touched_over_echo": 3.0,
            "cpu_idle_over_echo": 2.0,
        }
    )


def test_the_echo_finds_the_sequence_of_a_scan_in_its_line() -> None:
    echo = pytest.importorskip("benchmarks.latency.processes.echo", reason="needs rclpy")
    sensor = load_sensor()
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    scan.sequence, scan.device_time = 0x1234, 0x55667788
    (frame,) = make_codec(sensor).encode(scan, sensor.can.base_id)
    line = encode_line(frame)
    assert line[:1] == b"b"
    assert bytes.fromhex(line[echo.SEQUENCE].decode("ascii")) == b"\x34\x12"
