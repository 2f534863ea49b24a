"""Words of a command line, checked; and a command whose reader may go."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from collections.abc import Callable
from typing import Final

from posfet_model.config import ConfigError

_NAMESPACE: Final = re.compile(r"(?!.*__)[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
"""Namespaces that ROS takes, and that start with no number."""


def until_reader_goes(run: Callable[[], int]) -> int:
    """Run a command and return its exit code: 1, without a word, when whoever reads its output has gone (`| head`)."""
    try:
        code = run()
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains at its end
        return 1
    return code


def positive(text: str) -> float:
    """Return a finite number above 0, such as a time [s]; argparse tells what is wrong with a bad one.

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
    """Return a namespace without slashes around it; raise ConfigError when ROS would not take it."""
    namespace = given.strip("/")
    if not _NAMESPACE.fullmatch(namespace):
        raise ConfigError(f"namespace: must be names of a-z, A-Z, 0-9 and single _ joined by '/', got '{given}'")
    return namespace
