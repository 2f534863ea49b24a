# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Keys that are pressed in a terminal, one by one, without an echo."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from typing import Any


class TerminalKeys:
    """Context manager that reads keys where standard input is a terminal in the foreground, and restores it."""

    def __init__(self) -> None:
        self._input = -1
        self._before: list[Any] = []

    def __enter__(self) -> TerminalKeys:
        try:
            number = sys.stdin.fileno()
            # A process in the background would be stopped when it changes the terminal.
            if os.isatty(number) and os.tcgetpgrp(number) == os.getpgrp():
                self._before = termios.tcgetattr(number)
                tty.setcbreak(number)
                self._input = number
        except (OSError, ValueError, AttributeError, termios.error):
            pass  # standard input is closed, or something else than a terminal
        return self

    def __exit__(self, *_: object) -> None:
        if self._input >= 0:
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._before)
            self._input = -1

    @property
    def available(self) -> bool:
        """Whether keys are read."""
        return self._input >= 0

    def pressed(self) -> str:
        """Return the keys since the last call; those with a sequence of several characters are left out."""
        if self._input < 0 or not select.select([self._input], [], [], 0)[0]:
            return ""
        text = os.read(self._input, 1024).decode(errors="replace")
        return "" if text.startswith("\x1b") else text
