# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Drives a board through every rule of the protocol and collects the findings."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from posfet_driver.conformance import command_checks, frame_checks, status_checks, timer_checks
from posfet_driver.conformance.checks import CHECKS, NOT_OBSERVABLE, TOPICS, Check, Finding, Outcome, Phase, place
from posfet_driver.conformance.records import JITTER, BrokenRuleError, NotCheckedError
from posfet_driver.conformance.session import Session

__all__ = ["command_checks", "conform", "frame_checks", "status_checks", "timer_checks"]


def conform(session: Session, power_cycle: Callable[[], None] | None = None) -> list[Finding]:
    """Check every rule on a board.

    The board is stopped at the end, and has the scan period for the tests.

    Parameters
    ----------
    session : Session
        The board.
    power_cycle : callable, optional
        Asks for the board to be switched off and on, or does it; without it what follows power-on is not checked.

    Returns
    -------
    list of Finding
        One for each rule, in the order of the document.

    Raises
    ------
    NoBoardError
        When no board responds.
    can.CanError
        When the bus fails.
    """
    session.find()
    if power_cycle:
        session.switch_off_and_on(power_cycle)
    trials = [check for check in CHECKS if check.phase == Phase.TRIAL]
    reviews = [check for check in CHECKS if check.phase == Phase.REVIEW]
    session.numbers.shuffle(trials)
    seen: dict[str, list[tuple[Outcome, str]]] = {}
    for check in trials:
        seen.setdefault(check.rule, []).append(_try(check, session))
    with contextlib.suppress(NotCheckedError):
        session.settle()
    session.listen(JITTER)
    for check in reviews:
        seen.setdefault(check.rule, []).append(_try(check, session))
    return [_finding(rule, seen.get(rule, [])) for rule in (*session.description.rules, *TOPICS)]


def _try(check: Check, session: Session) -> tuple[Outcome, str]:
    try:
        return Outcome.PASS, check.run(session)
    except BrokenRuleError as error:
        return Outcome.FAIL, str(error)
    except NotCheckedError as error:
        return Outcome.NOT_CHECKED, str(error)


def _finding(rule: str, parts: list[tuple[Outcome, str]]) -> Finding:
    """Return the finding of a rule from those of its checks: a failure counts first, then what was checked."""
    parts = parts or [(Outcome.NOT_CHECKED, f"not observable: {NOT_OBSERVABLE[rule]}")]
    outcomes = [outcome for outcome, _ in parts]
    outcome = next(o for o in (Outcome.FAIL, Outcome.PASS, Outcome.NOT_CHECKED) if o in outcomes)
    told = [text for found, text in parts if outcome != Outcome.FAIL or found == Outcome.FAIL]
    return Finding(rule, outcome, "; ".join(dict.fromkeys(told)), place(rule))
