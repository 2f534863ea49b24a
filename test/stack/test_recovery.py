# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Real processes with an error of their own, and interrupted while they start."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from posfet_model.ros.exit_codes import INTERRUPTED, PROCESS_FAILED
from support.bringup_process import needs_installation
from support.expectations import TIMEOUT

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

BROKEN_MODEL = """
import sys
from posfet import bringup
from posfet_model.ros.model_node import ModelNode

def fail(node, scan):
    raise ValueError("odd\\nscan")

ModelNode.process = fail
sys.exit(bringup.main(sys.argv[1:]))
"""
DIVERGING_ESTIMATOR = """
import sys
from posfet import bringup
from posfet_model.ros.model_node import ModelNode

stream = ModelNode.stream

def spoilt(node, source, timeout):
    if node._reconstructor is not None:
        node._reconstructor._estimator.belief.slope[...] = float("nan")
    return stream(node, source, timeout)

ModelNode.stream = spoilt
sys.exit(bringup.main(sys.argv[1:]))
"""
"""Gives up its belief at the end of every block, in the thread that needs no interpreter."""
BROKEN_BOARD = """
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.ros import sim_board_node

def fail(board, now, until=None):
    raise ValueError("odd\\ntime")

BusBoard.due = fail
sim_board_node.main()
"""


def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)


@pytest.mark.parametrize("source", ["sim", "emulator"])
def test_a_stack_whose_model_fails_ends_with_its_exit_code(source: str) -> None:
    result = run(BROKEN_MODEL, f"source:={source}", "namespace:=broken")
    assert result.returncode == PROCESS_FAILED
    assert "data thread: restarted" in result.stderr
    assert result.stderr.splitlines()[-1].endswith(f"ending with exit code {PROCESS_FAILED}")


def test_a_stack_whose_compiled_estimator_diverges_goes_on() -> None:
    result = run(DIVERGING_ESTIMATOR, "source:=emulator", "namespace:=spoilt", "--for", "5")
    assert result.returncode == 0, result.stderr
    assert "a covariance must be positive" not in result.stderr
    assert "data thread: restarted" not in result.stderr
    assert int(result.stdout.split(" scans, ")[0].split()[-1]) > 100


def test_a_simulated_board_whose_thread_fails_ends_with_its_exit_code(tmp_path: Path) -> None:
    result = run(BROKEN_BOARD, "--ros-args", "-p", f"adapter_link:={tmp_path / 'can0'}")
    assert result.returncode == PROCESS_FAILED
    assert "source: ValueError: odd time" in result.stderr
    assert "source: restarted" in result.stderr


@pytest.mark.parametrize("composed", ["true", "false"])
def test_a_second_ctrl_c_during_startup_is_quiet(composed: str) -> None:
    noise = random.Random(3)
    command = ["posfet", "bringup", f"composed:={composed}", "namespace:=interrupted"]
    for _ in range(3):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        loaded = Path(f"/proc/{process.pid}/maps")
        while process.poll() is None and "_rclpy_pybind11" not in loaded.read_text(encoding="utf-8", errors="replace"):
            pass
        process.send_signal(signal.SIGINT)
        while process.poll() is None and noise.random() < 0.999:
            pass
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=TIMEOUT)
        assert process.returncode in {0, INTERRUPTED, -signal.SIGINT}, errors
        assert "Traceback" not in errors
        assert "KeyboardInterrupt" not in errors
