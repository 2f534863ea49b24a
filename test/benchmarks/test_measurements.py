# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Each benchmark makes its named values from what it measures; processes and clocks are replaced."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest
from cantools.database import load_file

pytest.importorskip("rich", reason="the tables of the benchmarks need rich")
pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.clock import Clock

from benchmarks import __main__ as command
from benchmarks import report
from benchmarks.latency import end_to_end, fresh_clone, startup, sustained_rate
from benchmarks.latency.baseline_stack.driver_node import BaselineDriver
from benchmarks.latency.processes import compiled_echo, echo
from benchmarks.latency.processes.board import StampingAdapter
from benchmarks.latency.rig import Measurement, Setup
from benchmarks.outcome import Outcome, Table
from benchmarks.simulation import board, recording_speed
from benchmarks.targets import TARGETS
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.fake_board import FakeBoard, make_scan, with_fd

READY = {"composed": 60.0, "echo": 40.0, "compiled echo": 20.0}
"""Times that the measurements of the tests have [us], by the processes."""


def measured(case: Setup) -> Measurement:
    """Return a measurement whose times say what was measured; of an idle sensor half of them."""
    ready = READY.get(case.stack, 100.0) * (1.0 if case.touched else 0.5)
    latency = np.full(100, 2 * ready)
    return Measurement(latency, np.full(100, ready), 0.1 * ready * case.rate / 1000.0, 100, 100, 0)


@pytest.fixture
def without_processes(monkeypatch: pytest.MonkeyPatch) -> list[Setup]:
    """Measure nothing; return what was asked for."""
    cases: list[Setup] = []
    monkeypatch.setattr(end_to_end, "run", lambda case: cases.append(case) or measured(case))
    return cases


def test_latencies_are_compared_with_both_echoes(
    monkeypatch: pytest.MonkeyPatch, without_processes: list[Setup]
) -> None:
    monkeypatch.setattr(compiled_echo, "compiled", lambda: Path("library"))
    outcome = end_to_end.measure(False)
    values = outcome.values
    assert values["ready_touched_over_echo"] == pytest.approx(1.5)
    assert values["ready_idle_over_echo"] == pytest.approx(0.75)
    assert values["cpu_touched_over_compiled_echo"] == pytest.approx(3.0)
    assert values["latency_p99_over_compiled_echo"] == pytest.approx(3.0)
    assert values["cpu_4khz_pct"] == pytest.approx(24.0)
    assert sum(case.stack == "compiled echo" for case in without_processes) == end_to_end.RUNS
    latency, ratios = outcome.tables
    assert [row[0] for row in latency.rows] == list(end_to_end.SHORT)
    assert len(ratios.columns) == 9
    assert dict(zip(ratios.columns, ratios.rows[0], strict=True))["ready p50 / compiled echo"] == pytest.approx(3.0)


@pytest.mark.usefixtures("without_processes")
def test_without_compiler_or_headers_the_row_of_the_compiled_echo_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> Path:
        raise compiled_echo.CannotCompile("g++ is not on PATH. Install with: sudo apt-get install g++")

    monkeypatch.setattr(compiled_echo, "compiled", missing)
    outcome = end_to_end.measure(False)
    assert outcome.values["ready_touched_over_echo"] == pytest.approx(1.5)
    assert not any("compiled_echo" in name for name in outcome.values)
    text = report.markdown(outcome.tables[0])
    assert (
        "| 5 x 5, 1 kHz, echo, compiled | skipped: g++ is not on PATH. Install with: sudo apt-get install g++ | -"
        in text
    )


def test_what_the_compiled_echo_needs_is_named(tmp_path: Path) -> None:
    with pytest.raises(compiled_echo.CannotCompile, match=r"g\+\+ is not on PATH\. Install with: sudo apt-get install"):
        compiled_echo.command({"PATH": str(tmp_path)}, tmp_path / "x")
    compiler = tmp_path / "g++"
    compiler.touch(0o755)
    environment = {"PATH": str(tmp_path), "AMENT_PREFIX_PATH": str(tmp_path)}
    with pytest.raises(compiled_echo.CannotCompile, match=r"rcl\.h is in none of the folders of AMENT_PREFIX_PATH"):
        compiled_echo.command(environment, tmp_path / "x")
    for path in ("include/rcl/rcl/rcl.h", "lib/librcl.so"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
    words = compiled_echo.command(environment, tmp_path / "x")
    assert words[0] == str(compiler)
    assert f"-I{tmp_path}/include/rcl" in words


def test_the_compiled_echo_finds_the_sequence_in_the_message() -> None:
    message = echo.empty_message(load_sensor())
    one, other = (bytes(message(sequence)) for sequence in compiled_echo.PROBES)
    at = compiled_echo.position(one, other)
    assert [index for index in range(len(one)) if one[index] != other[index]] == list(range(at, at + 8))
    with pytest.raises(ValueError, match="at -1 of one message"):
        compiled_echo.position(b"", other)


def test_the_library_of_the_compiled_echo_reports_what_it_cannot_do(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    try:
        library = compiled_echo.compiled()
    except compiled_echo.CannotCompile as reason:
        pytest.skip(str(reason))
    size = ctypes.c_size_t(8)
    code = ctypes.CDLL(str(library)).compiled_echo(
        0, bytes(8), size, ctypes.c_size_t(0), b"/nowhere.so", bytes(tmp_path)
    )
    assert code == 1
    assert "compiled_echo: /nowhere.so" in capfd.readouterr().err


def test_the_loaded_rate_is_measured_beside_one_busy_process_for_each_processor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    busy: list[Any] = []

    class Busy:
        def __init__(self, words: list[str]) -> None:
            assert words[1:] == ["-c", "while True: pass"]
            busy.append(self)

        def kill(self) -> None:
            busy.remove(self)

        def wait(self) -> None:
            pass

    asked: list[tuple[str, float, int]] = []

    def attempt(case: Setup) -> Measurement:
        asked.append((case.sensor, case.rate, len(busy)))
        limit = 6000.0 if busy else 1e9
        received = 100 if case.rate <= limit else 90
        return Measurement(np.full(100, 3000.0), np.zeros(0), 10.0, 100, received, 0)

    monkeypatch.setattr(subprocess, "Popen", Busy)
    monkeypatch.setattr(sustained_rate, "attempt", attempt)
    values = sustained_rate.measure(False).values
    assert values["sustained_5x5_hz"] == 12000.0
    assert values["sustained_5x5_loaded_hz"] == 6000.0
    assert values["sustained_5x5_loaded_p99_ms"] == pytest.approx(3.0)
    assert {number for _, _, number in asked} == {0, os.cpu_count()}
    assert not busy


def test_a_stack_that_does_not_start_on_a_loaded_machine_sustains_no_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(case: Setup) -> Measurement:
        raise RuntimeError("no line 'first'")

    monkeypatch.setattr(end_to_end, "run", run)
    rows: list[Any] = []
    assert sustained_rate.highest(5, 1.0, rows)[0] == 0.0
    values = sustained_rate.measure(False).values
    assert values["sustained_5x5_loaded_hz"] == 0.0
    assert "sustained_5x5_loaded_p99_ms" not in values
    assert report.markdown(Table("rates", end_to_end.COLUMNS, rows))


def test_the_start_is_compared_with_the_imports_of_the_same_run(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = iter([9.0, 0.5, 0.4, 0.6, 1.5, 1.4, 1.6])
    monkeypatch.setattr(startup, "first_message", lambda source: next(starts))
    monkeypatch.setattr(startup, "imports", lambda module: 0.25 if module == startup.LEAST else 0.1)
    values = startup.measure(False).values
    assert values == pytest.approx({"startup_s": 0.5, "startup_emulator_s": 1.5, "startup_over_imports": 1.6})


OUTPUT = "posfet: set-up [1/3] ...\nposfet: set up in 40 s\nposfet: build [6/6] posfet: 2.1s\n"


def test_set_up_is_the_time_of_a_fresh_clone() -> None:
    outcome = fresh_clone.outcome(0, OUTPUT, 70.5, 55.0)
    assert outcome.values == {"setup_s": 70.5, "setup_cpu_s": 55.0}
    assert outcome.tables[0].rows == [(".venv with its packages", 40.0), ("build", 30.5), ("both", 70.5)]


def test_set_up_without_a_network_is_skipped_and_a_failed_build_is_not() -> None:
    outcome = fresh_clone.outcome(2, "posfet: set-up [2/3] packages\nERROR: no network\n", 3.0, 1.0)
    assert outcome.skipped == "the packages of .venv cannot be had here: ERROR: no network"
    with pytest.raises(RuntimeError, match="make build failed in a fresh clone: make: no"):
        fresh_clone.outcome(2, f"{OUTPUT}make: no", 70.5, 55.0)


def test_set_up_says_where_it_cannot_be_measured(tmp_path: Path) -> None:
    assert "sourced ROS 2" in fresh_clone.unavailable({"ROS_DISTRO": "jazzy", "PATH": "/usr/bin"})
    assert (
        fresh_clone.unavailable({"PATH": str(tmp_path)}) == "git is not on PATH. Install with: sudo apt-get install git"
    )


def test_the_clone_does_not_use_the_environment_of_this_one() -> None:
    inside = f"{fresh_clone.ROOT}/.venv/bin"
    environment = {
        "PATH": os.pathsep.join([inside, "/usr/bin"]),
        "PYTHONPATH": "x",
        "HOME": "/home",
        "MAKEFLAGS": "-j9",
    }
    assert fresh_clone.clean(environment) == {"PATH": "/usr/bin", "HOME": "/home"}


def test_a_recording_is_timed_by_the_processor(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    times = iter(range(1000))
    monkeypatch.setattr(recording_speed.time, "process_time", lambda: float(next(times)))
    monkeypatch.setattr(recording_speed, "SECONDS", 0.02)
    pytest.importorskip("mcap")
    outcome = recording_speed.measure(False)
    assert outcome.values == pytest.approx({"mcap_5x5_realtime_factor": 0.02})
    assert [row[0] for row in outcome.tables[0].rows] == list(recording_speed.SCENES)
    with pytest.raises(RuntimeError, match="posfet sim nothing: exit code 1"):
        recording_speed.factor("nothing", tmp_path / "x.mcap", 0.01)


def test_without_the_package_mcap_the_row_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_speed.importlib.util, "find_spec", lambda name: None)
    assert recording_speed.measure(False).skipped.endswith("Install with: pip install mcap")


def test_the_simulated_board_is_timed_at_64_by_64(monkeypatch: pytest.MonkeyPatch) -> None:
    micro = {25: 20.0, 64 * 64: 40.0}
    monkeypatch.setattr(board, "cost", lambda sensor, *_: micro[sensor.layout.taxels])
    monkeypatch.setattr(board, "shortcut", lambda scene: (1.0, 2.0, 0.0, 0.5))
    values = board.measure(False).values
    assert values["sim_64x64_realtime_factor"] == pytest.approx(25.0)
    assert values["sim_5x5_cpu_pct"] == pytest.approx(2.0)


def test_results_carry_every_value_that_is_compared_between_machines(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    names = [
        "ready_touched_over_echo", "ready_idle_over_echo", "latency_p50_over_echo", "latency_p99_over_echo",
        "cpu_touched_over_echo", "cpu_idle_over_echo", "cpu_4khz_pct", "sustained_5x5_loaded_hz",
        "sim_64x64_realtime_factor", "mcap_5x5_realtime_factor", "offline_5x5_scans_per_s", "startup_over_imports",
        "setup_s",
    ]  # fmt: skip
    assert set(names) <= {target.name for target in TARGETS}
    monkeypatch.setattr(command, "FOLDER", tmp_path)
    monkeypatch.setattr(command, "RESULTS", tmp_path / "results")
    outcomes = {name: Outcome({name: 1.5}) for name in names}
    command.publish(outcomes, {}, {"commit": "abc"}, full=False)
    latest = json.loads((tmp_path / "results" / "latest.json").read_text(encoding="utf-8"))
    assert latest == {"commit": "abc", **dict.fromkeys(names, 1.5)}
    text = (tmp_path / "RESULTS.md").read_text(encoding="utf-8")
    assert all(f"| {name} |" in text for name in names)


def test_the_adapter_that_stamps_scans_changes_nothing_of_the_one_that_it_extends(tmp_path: Path) -> None:
    """An attribute of the same name ended every measurement of the latency."""
    sensor = load_sensor()
    firmware = BoardFirmware(sensor, FakeBoard(sensor), 0)
    plain = vars(EmulatedAdapter(str(tmp_path / "plain"), firmware))
    stamping = vars(StampingAdapter(str(tmp_path / "stamping"), firmware))
    assert {name: type(value) for name, value in stamping.items() if name in plain} == {
        name: type(value) for name, value in plain.items()
    }
    assert stamping.keys() - plain.keys() == {"times", "_unstamped"}


def test_the_baseline_implementation_publishes_what_a_frame_of_the_board_states() -> None:
    sensor = with_fd(load_sensor(), True)
    scan = make_scan(sensor, 77)
    ((identifier, _, data),) = make_codec(sensor).encode(scan, sensor.can.base_id)
    published: list[Any] = []
    node = SimpleNamespace(
        block=load_file(str(files("posfet_driver") / "protocol" / "posfet.dbc")).get_message_by_name("ScanBlockFd"),
        sensor=sensor,
        get_clock=Clock,
        raw=SimpleNamespace(publish=published.append),
    )
    BaselineDriver.on_message(node, can.Message(arbitration_id=identifier, data=data, is_fd=True))  # type: ignore[arg-type]
    (raw,) = published
    assert (raw.sequence, raw.device_time, list(raw.counts)) == (77, scan.device_time, scan.counts.tolist())
