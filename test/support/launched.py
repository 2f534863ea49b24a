"""Run a launch file for tests, where upstream's launch is installed."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.expectations import TIMEOUT

_PROGRAM = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

file, *words = sys.argv[1:]
service = LaunchService(noninteractive=True)
source = PythonLaunchDescriptionSource(file)
included = IncludeLaunchDescription(source, launch_arguments=[word.split(":=", 1) for word in words])
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


@contextmanager
def launching(file: Path, *words: str) -> Iterator[None]:
    """Run a launch file with arguments `name:=value`; interrupt it at the end, and expect that it ends cleanly."""
    command = [sys.executable, "-c", _PROGRAM, str(file), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield
    finally:
        process.send_signal(signal.SIGINT)
        try:
            output, _ = process.communicate(timeout=TIMEOUT)
        finally:
            process.kill()
        print(output)  # pytest shows it beside a failure
    assert process.returncode == 0
