"""Run the `bringup` executable for tests."""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from support.expectations import TIMEOUT

needs_installation = pytest.mark.skipif(
    shutil.which("posfet") is None, reason="needs the built workspace on PATH: source install/setup.bash"
)


@contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run `posfet bringup`; interrupt it (SIGINT) unless the test has ended it."""
    command = ["posfet", "bringup", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def finish(process: subprocess.Popen[str]) -> str:
    """Interrupt the process (SIGINT) and return its standard output; fail unless it ends cleanly."""
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors, errors
    return output


def bringup(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `posfet bringup` until it ends."""
    command = ["posfet", "bringup", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
