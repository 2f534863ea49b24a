"""Runs the `bringup` executable for tests."""

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
    """Run `posfet bringup`; end it with Ctrl-C's signal if the test has not."""
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
    """Send Ctrl-C's signal and return what was written to stdout, after a clean end."""
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors, errors
    return output


def bringup(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `posfet bringup` to its end."""
    command = ["posfet", "bringup", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
