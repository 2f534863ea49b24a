# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Checks a board against every rule of the protocol: `posfet can conform`."""

from __future__ import annotations

import argparse
import json
import random
import sys
from collections.abc import Sequence
from typing import Final

from rich.console import Console
from rich.table import Table
from rich.text import Text

from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.listening_board import LISTENS_ONLY
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.conformance.checks import DOCUMENT, Finding, Outcome
from posfet_driver.conformance.conformance import conform
from posfet_driver.conformance.records import Board, NoBoardError
from posfet_driver.conformance.session import Session
from posfet_driver.tools.bus_options import bus_of

COLOURS: Final = {Outcome.PASS: "green", Outcome.FAIL: "red", Outcome.NOT_CHECKED: "yellow"}


def run_conform(options: argparse.Namespace) -> int:
    """Run `posfet can conform`; return the exit code: 0 when no rule is broken."""
    with bus_of(options) as (sensor, settings):
        if sensor.mapping:
            raise CommandError(f"conform: {LISTENS_ONLY}")
        layout, link = sensor.layout, sensor.can
        board = Board(link.base_id, layout.taxels, layout.id, link.fd, round(1e6 / link.scan_rate), settings.fd)
        bus = open_bus(settings)
        try:
            session = Session(bus, options.clock, board, random.Random(options.seed))
            findings = conform(session, _ask_for_power_cycle if options.power_cycle else None)
        except NoBoardError as error:
            raise CommandError(str(error)) from error
        finally:
            bus.shutdown()
    _print(findings, options.json, session.description.rules)
    return int(any(finding.outcome == Outcome.FAIL for finding in findings))


def _ask_for_power_cycle() -> None:
    print("reset the board, or switch it off for a second and on again", file=sys.stderr, flush=True)


def _print(findings: Sequence[Finding], as_json: bool, rules: dict[str, str]) -> None:
    if as_json:
        rows = [
            {
                "rule": finding.rule,
                "text": rules.get(finding.rule, ""),
                "result": finding.outcome.value.lower(),
                "seen": finding.seen,
                "place": finding.place,
            }
            for finding in findings
        ]
        print(json.dumps({"findings": rows}, indent=1))
        return
    table = Table("rule", "result", "what was seen", DOCUMENT)
    for finding in findings:
        result = Text(finding.outcome.value, COLOURS[finding.outcome])
        table.add_row(finding.rule, result, finding.seen, finding.place.removeprefix(DOCUMENT))
    count = {outcome: sum(finding.outcome == outcome for finding in findings) for outcome in Outcome}
    console = Console(highlight=False, markup=False)
    console.print(table)
    console.print(
        f"{count[Outcome.PASS]} passed, {count[Outcome.FAIL]} failed, {count[Outcome.NOT_CHECKED]} not checked"
    )
