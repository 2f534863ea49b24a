"""The command `posfet` as real processes: what was begun is finished after Ctrl-C and SIGTERM."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest
from bringup_process import needs_installation
from expectations import TIMEOUT

pytestmark = [pytest.mark.process, needs_installation]

SIGNALS = [signal.SIGINT, signal.SIGTERM]


def interrupted(words: list[str], number: signal.Signals, file: Path) -> subprocess.CompletedProcess[str]:
    """Run `posfet`, and send the signal as soon as something is in the file."""
    with subprocess.Popen(["posfet", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        end = time.monotonic() + TIMEOUT
        while not (file.exists() and file.stat().st_size > 1000):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end
            time.sleep(0.05)
        process.send_signal(number)
        output, errors = process.communicate(timeout=TIMEOUT)
    return subprocess.CompletedProcess(words, process.returncode, output, errors)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_simulation_that_is_interrupted_leaves_a_whole_file(tmp_path: Path, number: signal.Signals) -> None:
    reader = pytest.importorskip("mcap.reader")
    file = tmp_path / "run.mcap"
    result = interrupted(["sim", "idle", "--out", str(file)], number, file)
    assert (result.returncode, result.stderr) == (130, "")
    assert result.stdout.startswith(f"{file}: ")
    with file.open("rb") as stream:
        assert reader.make_reader(stream, validate_crcs=True).get_summary().statistics.message_count > 100


@pytest.mark.parametrize("number", SIGNALS)
def test_a_recording_that_is_interrupted_is_whole(tmp_path: Path, number: signal.Signals) -> None:
    file = tmp_path / "bus.log"
    result = interrupted(["can", "record", str(file), "-i", "emulator"], number, file)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == f"{len(file.read_text(encoding='ascii').splitlines())} frames in {file}\n"
