# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

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
