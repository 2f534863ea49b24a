# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One process for each node of the graph."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from posfet.graph import NodeSpec
from posfet_model.config import ConfigError
from posfet_model.ros.exit_codes import PROCESS_FAILED
from posfet_model.ros.start import PARENT

STOP_TIMEOUT = 5.0
"""Time for the nodes to shut down before they are killed [s]."""


def executable(spec: NodeSpec) -> Path:
    """Return the installed executable of a node; raise ConfigError if there is none."""
    try:
        path = Path(get_package_prefix(spec.package)) / "lib" / spec.package / spec.executable
    except PackageNotFoundError as error:
        raise ConfigError(f"{spec.package}: not installed; source install/setup.bash first") from error
    if not path.is_file():
        raise ConfigError(f"{path}: no such executable; build the workspace again")
    return path


class Processes:
    """Context manager that starts the nodes, and stops all of them at its end."""

    def __init__(self, specs: Sequence[NodeSpec]) -> None:
        self._commands = [(spec, [str(executable(spec)), *spec.arguments]) for spec in specs]
        self._stack = ExitStack()
        self._running: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Processes:
        environment = {**os.environ, PARENT: str(os.getpid())}
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="posfet-"))
        for spec, command in self._commands:
            path = Path(folder, f"{spec.executable}.yaml")
            path.write_text(spec.parameter_file(), encoding="utf-8")
            command += ["--params-file", str(path)]
            # A separate session: Ctrl-C in the terminal reaches this process only, which then stops the nodes.
            self._running.append(subprocess.Popen(command, start_new_session=True, env=environment))
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            if process.poll() is None:
                process.terminate()  # SIGINT would give a traceback where Python itself is still starting
        deadline = time.monotonic() + STOP_TIMEOUT
        for process in self._running:
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._stack.close()

    def ended(self) -> bool:
        """Return whether a node has ended by itself."""
        return any(process.poll() is not None for process in self._running)

    def silent_ends(self) -> list[str]:
        """Return which nodes ended without a reason of their own, and how, in one line each: by a signal, or well."""
        ended = (
            (spec.name, process.returncode) for (spec, _), process in zip(self._commands, self._running, strict=True)
        )
        return [
            f"{name} {_end(code)}: the stack ends with it" for name, code in ended if code is not None and code <= 0
        ]

    def exit_code(self) -> int:
        """Return `PROCESS_FAILED` if a node ended with it, 1 if one ended otherwise than well, and else 0."""
        codes = {process.returncode for process in self._running} - {None, 0}
        return PROCESS_FAILED if PROCESS_FAILED in codes else int(bool(codes))


def _end(code: int) -> str:
    """Return how a process ended, by its return code: none of an error, which it has printed itself."""
    if code == 0:
        return "has ended"
    try:
        name = signal.Signals(-code).name
    except ValueError:  # a real-time signal
        name = f"signal {-code}"
    return f"was killed by {name}"
