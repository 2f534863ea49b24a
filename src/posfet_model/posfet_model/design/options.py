# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Options of `posfet design`, and which of them go together."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Final

from posfet_model._lib.shown import one_line
from posfet_model.command_line import positive
from posfet_model.config import ConfigError

_DESCRIPTION: Final = """\
Print the figures of merit of a POSFET sensor element, from film to ADC: sensitivity, leakage, noise by source, smallest
force, gain, bandwidth, phase margin, ringing, slew rate, power, and whether and why the design is not valid.

FILE.yaml has one key for each number, in SI units or as text with a unit (film_thickness: 2.5 um); docs/design.md lists
the keys. In place of a file, the name of a shipped design (--list). What is not in the file has the paper's value.

Measured figures of the op-amp go into the key 'measured' (gain_db, gbw_hz, phase_margin_deg). With sizes and bias in
the same file, load and compensation are calibrated to them, and the follower is within 0.5 % of the measured one; with
the figures alone, second pole and zero are not known: fast inputs, and samples that may slew, are not valid."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(
        prog="posfet design", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", nargs="?", metavar="FILE.yaml", help="design file, or name of a shipped design")
    parser.add_argument("--list", action="store_true", help="print the names of the shipped designs")
    parser.add_argument("--json", action="store_true", help="print JSON; what is unknown or infinite is null")
    parser.add_argument("--netlist", type=Path, metavar="OUT.cir", help="write the op-amp as a SPICE subcircuit")
    parser.add_argument("--simulate", type=Path, metavar="INPUT.csv", help="run the follower on a signal, t,vin [s, V]")
    parser.add_argument("--out", type=Path, metavar="OUTPUT.csv", help="where to write its output, t,vin,vout")
    parser.add_argument("--dt", type=positive, metavar="S", help="even steps [s] instead of the input's own times")
    parser.add_argument(
        "--linear", action="store_true", help="simulate small signals only: two poles and a zero, much faster"
    )
    parser.add_argument("--sweep", type=Path, metavar="OUT.csv", help="compute the ranges of the file's key 'sweep'")
    parser.add_argument("--plot", type=Path, metavar="OUT.svg", help="draw the Pareto front of the sweep (matplotlib)")
    parser.add_argument("--tolerance", type=Path, metavar="OUT.csv", help="Monte Carlo by the file's key 'tolerance'")
    parser.add_argument(
        "--jobs",
        type=_jobs,
        metavar="N",
        help="processes of a sweep, where joblib is installed (default: processors)",
    )
    return parser


def _jobs(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"must be a whole number in [1, 1024], got '{text}'")
    return int(text)


def check_options(options: argparse.Namespace) -> None:
    """Raise ConfigError for options that do not go together, files that replace each other or cannot be written."""
    if not options.file:
        raise ConfigError("give the path of a design file, or the name of a shipped one (--list)")
    if (options.out is None) != (options.simulate is None):
        raise ConfigError("--simulate and --out must be given together")
    if (options.dt is not None or options.linear) and options.simulate is None:
        raise ConfigError(f"{'--linear' if options.linear else '--dt'} needs --simulate")
    if options.plot is not None and options.sweep is None:
        raise ConfigError("--plot needs --sweep")
    _check_outputs(options)


def _check_outputs(options: argparse.Namespace) -> None:
    taken = {os.path.realpath(options.file): "design file"}
    if options.simulate is not None:
        taken[os.path.realpath(options.simulate)] = "input of --simulate"
    for name in ("netlist", "out", "sweep", "plot", "tolerance"):
        path = getattr(options, name)
        if path is None:
            continue
        where = os.path.realpath(path)
        if where in taken:
            raise ConfigError(f"--{name}: {one_line(str(path))} is the {taken[where]}, too; give another name")
        taken[where] = f"file of --{name}"
        if os.path.isdir(where):
            raise ConfigError(f"--{name}: {one_line(str(path))} is a folder; give the name of a file")
        if not os.path.isdir(path.parent):
            raise ConfigError(f"--{name}: {one_line(str(path))}: there is no such folder; make it first")
