# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a session with a board under test keeps: its commands, answers, runs and windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from posfet_driver.conformance.seen_scans import SeenFrame

JITTER: Final = 0.02
"""Longest time by which host and adapter delay one frame more than another [s]; assumed."""
LATE_SHARE: Final = 0.2
"""Share of frames that a busy host may read later than that [1]; assumed."""
LONGEST_WAIT: Final = 1.0
"""Time after which a command counts as not answered [s]."""
SILENCE: Final = 0.5
"""Time without a frame after which a board is off [s]."""
PATIENCE: Final = 120.0
"""Time within which a person switches the board off and on [s]."""
MICROSECOND: Final = 1000
SECOND: Final = 1_000_000_000


class NotCheckedError(Exception):
    """A rule cannot be judged; the message is the reason, one line."""


class BrokenRuleError(Exception):
    """The board breaks the rule; the message is what was seen, one line."""


class NoBoardError(Exception):
    """No board was found; the message is one line."""


@dataclass(frozen=True)
class Board:
    """What the tester knows of the board."""

    base: int
    """Base identifier."""
    taxels: int
    layout: int
    """Layout id."""
    fd: bool
    """Whether its scans are FD blocks."""
    period: int
    """Scan period for the tests [us]."""
    fd_bus: bool
    """Whether the bus carries FD frames."""

    @property
    def blocks(self) -> int:
        """Number of blocks of a scan."""
        return -(-self.taxels // (26 if self.fd else 5))

    @property
    def highest_offset(self) -> int:
        """Highest identifier less the base identifier; those above may be another board's."""
        return 5 if self.fd else 7 + self.blocks


@dataclass(frozen=True)
class Answer:
    """A command and its response."""

    code: int
    argument: int
    result: int
    value: int
    sent: int
    """Host's clock at sending [ns]."""
    before: int
    """Number of frames received before it was sent."""
    frame: SeenFrame
    """The response."""


@dataclass(frozen=True)
class SentCommand:
    """A command as it was sent."""

    code: int
    tag: int
    argument: int
    time: int
    """Host's clock [ns]."""
    before: int
    """Number of frames received before."""


@dataclass
class Run:
    """Frames from START to STOP."""

    start: Answer
    owner: str
    """Rule that is tried out in this run; '': none, the board is only listened to."""
    stop: Answer | None = None
    end: int = 0
    """Number of frames received when no more of the run can follow."""


@dataclass(frozen=True)
class Window:
    """A time without commands."""

    scanning: bool
    begin: int
    """Host's clock [ns]."""
    end: int
    first: int
    """Number of frames received before."""
    last: int


@dataclass
class PowerOn:
    """What was seen after the board had been switched on."""

    boot_before: int
    first: int
    """Number of frames received before."""
    run: Run | None = None
