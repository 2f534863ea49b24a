# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Command-line options that several commands share: one definition of each."""

from __future__ import annotations

import argparse
from typing import Final

from posfet_model.parameters import SENSOR_FILE, SERIAL
from posfet_sim.defaults import SEED_MAX
from posfet_sim.parameters import IMPERFECTIONS, SCENE, SEED

MAX_DURATION: Final = 1e6
"""Maximum duration of a run [s]."""


def add_scene(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add the positional argument for the scene; it is required without a default.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser to extend.
    default : str, optional
        Scene without the argument; default: the argument is required.
    """
    if default is None:
        parser.add_argument("scene", metavar="SCENE", help=SCENE.description)
        return
    parser.add_argument("scene", metavar="SCENE", nargs="?", default=default, help=SCENE.help)


def add_sensor(parser: argparse.ArgumentParser) -> None:
    """Add `--sensor`, the sensor description."""
    parser.add_argument("--sensor", metavar="SENSOR", default=SENSOR_FILE.default, help=SENSOR_FILE.help)


def add_serial(parser: argparse.ArgumentParser) -> None:
    """Add `--serial`, the serial number of the sensor."""
    parser.add_argument("--serial", metavar="SERIAL", default=SERIAL.default, help=SERIAL.help)


def add_error_model(parser: argparse.ArgumentParser) -> None:
    """Add `--imperfections`, the error model of the simulated board."""
    parser.add_argument("--imperfections", metavar="MODEL", default=IMPERFECTIONS.default, help=IMPERFECTIONS.help)


def add_seed(parser: argparse.ArgumentParser, default: int) -> None:
    """Add `--seed`, the seed of everything random on the simulated board.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser to extend.
    default : int
        Seed without the option.
    """
    described = f"{SEED.description} (default: {default})"
    parser.add_argument("--seed", metavar="SEED", type=seed, default=default, help=described)


def add_duration(parser: argparse.ArgumentParser) -> None:
    """Add `--for`, the simulated duration [s]; None without it."""
    described = "simulated duration [s] (default: once through the scene)"
    parser.add_argument("--for", metavar="SECONDS", dest="seconds", type=duration, help=described)


def seed(text: str) -> int:
    """Return a seed.

    Parameters
    ----------
    text : str
        Text of the argument.

    Examples
    --------
    >>> seed("7")
    7
    """
    if not text.isdecimal() or int(text) > SEED_MAX:
        raise argparse.ArgumentTypeError(f"must be a whole number in [0, {SEED_MAX}], got '{text}'")
    return int(text)


def duration(text: str) -> float:
    """Return a duration [s] in (0, `MAX_DURATION`].

    Parameters
    ----------
    text : str
        Text of the argument.

    Examples
    --------
    >>> duration("0.5")
    0.5
    """
    value = _number(text)
    if not 0 < value <= MAX_DURATION:
        raise argparse.ArgumentTypeError(f"must be a number in (0, {MAX_DURATION:g}], got '{text}'")
    return value


def number_in(text: str, low: float, high: float) -> float:
    """Return a number in [low, high].

    Parameters
    ----------
    text : str
        Text of the argument.
    low : float
        Lower end of the range.
    high : float
        Upper end of the range.

    Examples
    --------
    >>> number_in("20", -90, 1000)
    20.0
    """
    value = _number(text)
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"must be a number in [{low:g}, {high:g}], got '{text}'")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
