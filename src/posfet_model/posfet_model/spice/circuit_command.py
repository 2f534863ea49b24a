# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The commands `spice_compare circuits` and `spice_compare random`."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from posfet_model.spice import ngspice
from posfet_model.spice.circuit_comparison import Comparison, compare_all
from posfet_model.spice.circuit_models import WAYS
from posfet_model.spice.circuits import CIRCUITS, Circuit
from posfet_model.spice.comparison_table import table
from posfet_model.spice.netlist import subcircuit
from posfet_model.spice.random_designs import confusion_table, verdicts
from posfet_model.spice.record_file import Record, load
from posfet_model.spice.recorded_runs import record

COMMANDS: Final = ("circuits", "random", "netlist")
"""Names of the commands."""


def run(arguments: Sequence[str]) -> int:
    """Run a command; return the exit code: 0, 1 where a target is missed, 2 where the runs cannot be had.

    Parameters
    ----------
    arguments : sequence of str
        The command and its options.

    Returns
    -------
    int
        Exit code.
    """
    options = _parser().parse_args(arguments)
    try:
        return int(options.action(options))
    except (ngspice.SpiceError, OSError, ValueError) as error:
        print(f"spice_compare: {error}", file=sys.stderr)
        return 2


def _circuits(options: argparse.Namespace) -> int:
    chosen = {name: CIRCUITS[name] for name in options.circuit or CIRCUITS}
    ways = {name: WAYS[name] for name in options.model or WAYS}
    found = list(compare_all(chosen, _source(options.recorded), ways))
    if options.json:
        print(json.dumps([_as_json(part) for part in found], indent=1))
    else:
        print(table(found))
    return int(any(part.misses() for part in found))


def _source(folder: Path | None) -> Callable[[Circuit], Record]:
    if folder is None:
        return record
    return lambda circuit: load(folder / f"{circuit.name}.npz")


def _as_json(part: Comparison) -> dict[str, object]:
    """Return a comparison for JSON: NaN is null."""
    loop = asdict(part.loop)
    values = {
        name: [None if isinstance(one, float) and math.isnan(one) else one for one in value]
        for name, value in loop.items()
        if not isinstance(value, str)
    }
    runs = [{**asdict(run), "met": run.met} for run in part.runs]
    return {
        "circuit": loop["circuit"],
        "model": loop["way"],
        "spice_and_model": values,
        "runs": runs,
        "misses": part.misses(),
    }


def _random(options: argparse.Namespace) -> int:
    found = list(verdicts(options.count, options.seed))
    print(confusion_table(found))
    return int(any((one.spice == "unstable") != (one.model == "unstable") for one in found))


def _netlist(options: argparse.Namespace) -> int:
    print(subcircuit(CIRCUITS[options.name]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="spice_compare", description=__doc__)
    commands = parser.add_subparsers(required=True)
    circuits = commands.add_parser(
        "circuits",
        help="compare the models of the set of circuits with ngspice; exit code 1 if a target is missed",
        description="Compare the models of the set of circuits with ngspice. Exit code 1 if a target is missed.",
    )
    circuits.add_argument("--recorded", type=Path, metavar="FOLDER", help="recorded runs in place of ngspice")
    circuits.add_argument("--circuit", choices=CIRCUITS, action="append", metavar="NAME", help="only this circuit")
    circuits.add_argument("--model", choices=WAYS, action="append", help="only the model made of this")
    circuits.add_argument("--json", action="store_true", help="print JSON in place of tables")
    circuits.set_defaults(action=_circuits)
    random = commands.add_parser(
        "random",
        help="compare verdicts about the stability of random designs; exit code 1 if one differs",
        description="Compare verdicts about random designs with those of ngspice. Exit code 1 if one differs.",
    )
    random.add_argument("--count", type=int, default=100, help="number of designs, default 100")
    random.add_argument("--seed", type=int, default=1, help="of the random generator, default 1")
    random.set_defaults(action=_random)
    written = commands.add_parser("netlist", help="print the netlist of a circuit of the set")
    written.add_argument("name", choices=CIRCUITS, metavar="NAME", help="the circuit")
    written.set_defaults(action=_netlist)
    return parser
