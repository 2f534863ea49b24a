# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Show what colcon, whose output is piped in, is doing: one line per package, on a terminal with a progress bar.

``colcon build ... | progress.py 5``, with the number of packages.
Runs with any Python from 3.10 on, before anything is installed.
"""

from __future__ import annotations

import re
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import TextIO

BAR = 24
"""Characters of a bar."""
KEPT = 40
"""Lines of output that are printed when a package fails."""


class Step:
    """One step of a set-up: a line when it begins and a line when it ends; on a terminal the same line, with a bar.

    Parameters
    ----------
    stream : TextIO
        Where the lines go.
    clock : callable
        Returns the time [s].

    Attributes
    ----------
    terminal : bool
        Whether the stream is a terminal.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self.terminal = stream.isatty()
        self._started = clock()

    def say(self, text: str) -> None:
        """Print a line for good."""
        self._stream.write(f"\r\x1b[K{text}\n" if self.terminal else f"{text}\n")
        self._stream.flush()

    def show(self, label: str, share: float, detail: str) -> None:
        """Draw the bar; nothing without a terminal."""
        if not self.terminal:
            return
        full = round(BAR * min(share, 1.0))
        line = f"{label} [{'#' * full}{'-' * (BAR - full)}] {self.elapsed:3.0f} s  {detail}"
        self._stream.write(f"\r\x1b[K{line[:99]}")
        self._stream.flush()

    @property
    def elapsed(self) -> float:
        """Return the time since the step began [s]."""
        return self._clock() - self._started


def colcon(lines: Iterable[str], total: int, step: Step) -> None:
    """Follow `colcon build`.

    Parameters
    ----------
    lines : iterable of str
        Its output with the event handlers console_direct and console_start_end.
    total : int
        Packages to build.
    step : Step
        Where to show it.
    """
    running: list[str] = []
    done = 0
    percent = 0
    kept: deque[str] = deque(maxlen=KEPT)
    for line in lines:
        kept.append(line)
        if found := re.match(r"Starting >>> (\S+)", line):
            running.append(found[1])
        elif found := re.match(r"\[ *(\d+)%\]", line):
            percent = int(found[1])
        elif found := re.match(r"Finished <<< (\S+) (?:\[(.*)\])?", line):
            running.remove(found[1])
            done += 1
            percent = 0
            step.say(f"posfet: build [{done}/{total}] {found[1]}: {found[2]}")
        elif re.match(r"(Failed|Aborted) +<<<", line):
            step.say("".join(kept).rstrip())
            kept.clear()
        step.show("posfet: build", (done + percent / 100) / total, ", ".join(running) or "starting")
    if running or done < total:
        step.say(f"posfet: build: {done} of {total} packages after {step.elapsed:.0f} s")


def main(words: list[str]) -> int:
    """Follow a build of as many packages as the first argument says, and return the exit code."""
    colcon(sys.stdin, int(words[0]), Step(sys.stdout))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
