# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Commands as real processes: output is complete after Ctrl-C and SIGTERM; a closed pipe is no error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from support.bringup_process import needs_installation
from support.expectations import TIMEOUT
from support.paths import DATA

pytestmark = [pytest.mark.process, needs_installation]

RUN = DATA / "spice" / "opamp_b_tap.csv"
SIGNALS = [signal.SIGINT, signal.SIGTERM]


def interrupted(words: list[str], number: signal.Signals, file: Path) -> subprocess.CompletedProcess[str]:
    """Run `posfet` and send the signal as soon as the file has content."""
    with subprocess.Popen(["posfet", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        end = time.monotonic() + TIMEOUT
        while not (file.exists() and file.stat().st_size > 1000):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end
            time.sleep(0.05)
        process.send_signal(number)
        output, errors = process.communicate(timeout=TIMEOUT)
    return subprocess.CompletedProcess(words, process.returncode, output, errors)


@pytest.mark.parametrize(
    "command",
    [["posfet", "bringup", "-s"], [sys.executable, "-m", "posfet_model.spice_compare", str(RUN)]],
    ids=["posfet", "spice_compare"],
)
def test_a_closed_output_pipe_ends_a_command_quietly(command: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as pipe:
        result = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, text=True, timeout=TIMEOUT, check=False)
    assert (result.returncode, result.stderr) == (1, "")


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupted_simulation_leaves_a_complete_file(tmp_path: Path, number: signal.Signals) -> None:
    reader = pytest.importorskip("mcap.reader")
    file = tmp_path / "run.mcap"
    result = interrupted(["sim", "idle", "--out", str(file)], number, file)
    assert (result.returncode, result.stderr) == (130, "")
    assert result.stdout.startswith(f"{file}: ")
    with file.open("rb") as stream:
        assert reader.make_reader(stream, validate_crcs=True).get_summary().statistics.message_count > 100


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupted_recording_is_complete(tmp_path: Path, number: signal.Signals) -> None:
    file = tmp_path / "bus.log"
    result = interrupted(["can", "record", str(file), "-i", "emulator"], number, file)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == f"{len(file.read_text(encoding='ascii').splitlines())} frames in {file}\n"
