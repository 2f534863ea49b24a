# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Run a launch file for tests, where upstream's launch is installed, and watch the processes that it starts."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile

from support.expectations import TIMEOUT

INCLUDING = """
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


class Launch:
    """A launch file that runs in a process of its own."""

    def __init__(self, command: list[str], output: Path) -> None:
        with output.open("w", encoding="utf-8") as file:  # a pipe that nobody reads would fill, and hold the launch up
            self.process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        self._output = output

    def printed(self) -> str:
        """Return what it and its processes have printed."""
        return self._output.read_text(encoding="utf-8")

    def nodes(self) -> dict[int, str]:
        """Return the running processes of this stack with their command lines."""
        return {pid: line for pid, line in children(self.process.pid).items() if "posfet" in line}

    def wait_for(self, text: str) -> None:
        """Wait until a text is printed; fail if the launch ends before."""
        end = time.monotonic() + TIMEOUT
        while text not in (printed := self.printed()):
            assert self.process.poll() is None, printed
            assert time.monotonic() < end, printed
            time.sleep(0.01)


@contextmanager
def launched(file: Path, *words: str, program: str = INCLUDING) -> Iterator[Launch]:
    """Run a program with a launch file and arguments `name:=value` in its command line; kill it at the end."""
    with NamedTemporaryFile(suffix=".log") as log:
        launch = Launch([sys.executable, "-c", program, str(file), *words], Path(log.name))
        try:
            yield launch
        finally:
            launch.process.kill()
            launch.process.wait()
            print(launch.printed())  # pytest shows it beside a failure


@contextmanager
def launching(file: Path, *words: str) -> Iterator[Launch]:
    """Run a launch file with arguments `name:=value`; interrupt it at the end, and expect that it ends cleanly."""
    with launched(file, *words) as launch:
        yield launch
        launch.process.send_signal(signal.SIGINT)
        assert launch.process.wait(TIMEOUT) == 0


def children(process: int) -> dict[int, str]:
    """Return the running children of a process with their command lines."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[:2]
            line = (folder / "cmdline").read_text(encoding="utf-8", errors="replace").replace("\0", " ")
        except OSError:  # it has just ended
            continue
        if int(parent) == process and state != "Z":
            found[int(folder.name)] = line
    return found


def wait_until_ended(processes: dict[int, str]) -> None:
    """Wait until none of the processes runs; fail after TIMEOUT."""
    end = time.monotonic() + TIMEOUT
    while alive := [line for pid, line in processes.items() if Path(f"/proc/{pid}/exe").exists()]:
        assert time.monotonic() < end, alive
        time.sleep(0.01)
