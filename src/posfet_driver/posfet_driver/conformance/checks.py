# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The list of all checks, and what they find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeAlias

from posfet_driver.conformance.session import Session

DOCUMENT: Final = "docs/protocol.md"

CheckFunction: TypeAlias = Callable[[Session], str]
"""Returns what was seen; raises BrokenRuleError or NotCheckedError."""


class Outcome(Enum):
    """Result for one rule."""

    PASS = "pass"
    FAIL = "FAIL"
    NOT_CHECKED = "not checked"


class Phase(Enum):
    """When a check runs."""

    TRIAL = "trial"
    """Sends commands; trials run in any order, each begins with a stopped board."""
    REVIEW = "review"
    """Reviews all that was seen in the trials."""


@dataclass(frozen=True)
class Check:
    """A check of a rule; a rule may have several."""

    rule: str
    phase: Phase
    run: CheckFunction


@dataclass(frozen=True)
class Finding:
    """What was found for one rule."""

    rule: str
    outcome: Outcome
    seen: str
    """What was seen, or why nothing was."""
    place: str
    """Where the document states the rule."""


TOPICS: Final = {
    "offsets": "identifiers",
    "checksum": "scanblockfd",
    "identity": "identity",
    "states": "commands",
    "commands": "commands",
}
"""What the protocol demands besides its numbered rules, with its place in the document."""

NOT_OBSERVABLE: Final = {
    "I5": "the age of a measurement is not on the bus",
}
"""Rules that no frame can show, with the reason."""

CHECKS: Final[list[Check]] = []
"""All checks; filled by the modules that define them."""


def check(rule: str, phase: Phase = Phase.TRIAL) -> Callable[[CheckFunction], CheckFunction]:
    """Return a decorator that adds a function to the checks of a rule.

    Parameters
    ----------
    rule : str
        Id of the rule, or a topic.
    phase : Phase, optional
        When it runs.
    """

    def add(function: CheckFunction) -> CheckFunction:
        CHECKS.append(Check(rule, phase, function))
        return function

    return add


def place(rule: str) -> str:
    """Return where the document states a rule.

    Parameters
    ----------
    rule : str
        Id of the rule, or a topic.
    """
    return f"{DOCUMENT}#{TOPICS.get(rule, rule.lower())}"
