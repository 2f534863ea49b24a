# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Checks of command-line arguments, the exit code for bad ones, and a command whose output pipe may be closed."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
import time
from collections.abc import Callable
from typing import Final

from posfet_model.config import ConfigError

BAD_INPUT: Final = 1
"""Exit code of a command for input that cannot be used."""

_NAMESPACE: Final = re.compile(r"(?!.*__)[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
"""Valid ROS namespaces."""

_BAR: Final = 30  # characters
_REDRAW: Final = 0.1  # s


def ignoring_broken_pipe(run: Callable[[], int]) -> int:
    """Run a command and return its exit code: 1, without a message, if its output pipe is closed (``| head``)."""
    try:
        code = run()
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python reports it again at exit
        return 1
    return code


def positive(text: str) -> float:
    """Return a finite number above 0, such as a time [s], as an argparse type.

    Parameters
    ----------
    text : str
        Text of the argument.

    Examples
    --------
    >>> positive("2.5")
    2.5
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"must be a number above 0, got '{text}'")
    return value


def checked_namespace(given: str) -> str:
    """Return a namespace without leading and trailing slashes; raise ConfigError if it is not valid in ROS."""
    namespace = given.strip("/")
    if not _NAMESPACE.fullmatch(namespace):
        raise ConfigError(f"namespace: must be names of a-z, A-Z, 0-9 and single _ joined by '/', got '{given}'")
    return namespace


def progress_bar(total: int, what: str) -> Callable[[int], None]:
    """Return a callback that draws a progress bar on standard error, on a terminal only; unchecked.

    Parameters
    ----------
    total : int
        Number at which it is done.
    what : str
        What is counted.
    """
    if not sys.stderr.isatty():
        return lambda done: None
    drawn = 0.0

    def draw(done: int) -> None:
        nonlocal drawn
        if done < total and time.monotonic() - drawn < _REDRAW:
            return
        drawn = time.monotonic()
        bar = "#" * (_BAR * done // total)
        end = "\r\033[K" if done == total else ""
        sys.stderr.write(f"\r[{bar:{_BAR}}] {done}/{total} {what}{end}")
        sys.stderr.flush()

    return draw
