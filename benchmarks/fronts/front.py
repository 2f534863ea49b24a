# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A front: choices of one stage with run time and error, its reference, and the checks that make it trustworthy."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.outcome import shown

MOST_SERIES = 7
"""Largest number of series that a reader can tell apart."""

SENTENCES = range(2, 6)
"""Numbers of sentences that a reader may be given beside a figure: what is measured, then what to choose."""

ERROR_NOISE = 1.02
"""An error counts as larger than another from this ratio on."""


class FrontError(RuntimeError):
    """A front that contradicts theory, its table or its text."""


@dataclass(frozen=True)
class Effort:
    """How much to measure."""

    repeats: int
    """Interleaved repetitions of each timed call."""
    short: bool
    """Whether scenes and grids are cut to what shows that everything works."""


@dataclass(frozen=True)
class Check:
    """A quantity with the range that theory, or the text, requires."""

    what: str
    value: float
    low: float
    high: float

    @property
    def passed(self) -> bool:
        """Whether the value is in the range; NaN is not."""
        return self.low <= self.value <= self.high

    def __str__(self) -> str:
        above, below = math.isfinite(self.low), math.isfinite(self.high)
        required = (
            f"in {shown(self.low)} to {shown(self.high)}"
            if above and below
            else f"at least {shown(self.low)}"
            if above
            else f"at most {shown(self.high)}"
        )
        return f"{self.what}: {shown(self.value)}, required {required}"


@dataclass(frozen=True)
class Choice:
    """One way to do the work of a stage."""

    series: str
    """Method; the choices of a series differ in one parameter."""
    parameter: str
    """Value of that parameter; empty: there is none."""
    error: float
    seconds: tuple[float, ...]
    """Processor time of the unit of work in each repetition [s]."""
    more: tuple[float, ...] = ()
    """Further figures, by the front's `columns`."""

    @property
    def name(self) -> str:
        """Series and parameter."""
        return f"{self.series}, {self.parameter}" if self.parameter else self.series

    @property
    def median(self) -> float:
        """Median processor time [s]."""
        return float(np.median(self.seconds))

    @property
    def quartiles(self) -> tuple[float, float]:
        """First and third quartile of the processor time [s]."""
        low, high = np.quantile(self.seconds, (0.25, 0.75))
        return float(low), float(high)


@dataclass(frozen=True)
class Front:
    """Choices of one stage on the same work, with the same input, units and interval."""

    name: str
    """File name without suffix, and key of the results."""
    title: str
    work: str
    """What the run time is for."""
    error_label: str
    """Quantity and unit of the error."""
    reference: str
    """What the errors are against."""
    uncertainty: float
    """Error of the reference; smaller errors are not separated. 0: exact."""
    choices: tuple[Choice, ...]
    shipped: str
    """Name of the choice that the stack makes, read from its code; empty: the stage has several uses."""
    checks: tuple[Check, ...]
    reading: str
    """What to choose and why; numbers in it are made from the measurement."""
    why_not: str | Mapping[str, str] = ""
    """Why the shipped choice is not on the Pareto set, where it is not; by name or series of what beats it, '' for any
    other."""
    question: str = ""
    """What a reader wants to do, for the table at the top of the document; empty: not in it."""
    rival: str = ""
    """Name of the choice with which that table compares what is shipped."""
    swept: bool = True
    """Whether the points of a series are joined: they are one scene with one parameter that changes."""
    columns: tuple[str, ...] = ()
    """Headings of the choices' further figures."""

    def counted(self, choice: Choice) -> float:
        """Return the error, or that of the reference if larger."""
        return max(choice.error, self.uncertainty)

    def beats(self, one: Choice, other: Choice) -> bool:
        """Return whether a choice is better than another beyond noise in one respect, and not worse in the other."""
        errors, medians = (self.counted(one), self.counted(other)), (one.median, other.median)
        if errors[0] > errors[1] or medians[0] > medians[1]:
            return False
        return errors[1] > ERROR_NOISE * errors[0] or one.quartiles[1] < other.quartiles[0]

    @cached_property
    def pareto(self) -> tuple[Choice, ...]:
        """Choices that no other beats, by ascending run time."""
        best = [each for each in self.choices if not any(self.beats(other, each) for other in self.choices)]
        return tuple(sorted(best, key=lambda choice: choice.median))

    @cached_property
    def shipped_choice(self) -> Choice | None:
        """The choice that the stack makes."""
        return next((choice for choice in self.choices if choice.name == self.shipped), None)

    @cached_property
    def unit(self) -> Choice:
        """The choice whose run time is 1: the shipped one, or the fastest."""
        return self.shipped_choice or min(self.choices, key=lambda choice: choice.median)

    def ratio(self, choice: Choice) -> float:
        """Return the run time of a choice in units of `unit`."""
        return choice.median / self.unit.median

    def verify(self) -> None:
        """Raise FrontError unless the front is complete, legible, and passes its checks."""
        wrong = [str(check) for check in self.checks if not check.passed]
        if not self.checks:
            wrong.append("no check")
        if len({choice.name for choice in self.choices}) < len(self.choices):
            wrong.append("two choices have one name")
        if len({choice.series for choice in self.choices}) > MOST_SERIES:
            wrong.append(f"more than {MOST_SERIES} series")
        if (found := sentences(self.reading)) not in SENTENCES:
            wrong.append(f"{found} sentences of reading, not {SENTENCES[0]} to {SENTENCES[-1]}")
        if bool(self.question) != any(choice.name == self.rival for choice in self.choices):
            wrong.append(f"question {self.question!r} and choice to compare with {self.rival!r}")
        if self.shipped and self.shipped_choice is None:
            wrong.append(f"the shipped choice {self.shipped!r} was not measured")
        for choice in self.choices:
            if not (0 <= choice.error < math.inf and choice.seconds and min(choice.seconds) > 0):
                wrong.append(f"{choice.name}: error {choice.error}, run times {choice.seconds}")
            if len(choice.more) != len(self.columns):
                wrong.append(f"{choice.name}: {len(choice.more)} further figures, not {len(self.columns)}")
        if wrong:
            raise FrontError(f"{self.name}: " + "; ".join(wrong))

    @property
    def verdict(self) -> str:
        """Whether the shipped choice is on the Pareto set, and if not, what beats it and why it is shipped."""
        shipped = self.shipped_choice
        if shipped is None:
            return ""
        better = [each for each in self.choices if self.beats(each, shipped)]
        if not better:
            return f"The shipped choice, {shipped.name}, is on the Pareto set."
        better.sort(key=lambda choice: (self.counted(choice), choice.median))
        by_reason: dict[str, Choice] = {}
        for each in better:
            by_reason.setdefault(self._reason(each), each)
        reasons = [
            f"{each.name} has {shown(self.counted(each) / self.counted(shipped))} of its error in "
            f"{shown(self.ratio(each))} of its run time. {reason}"
            for reason, each in by_reason.items()
        ]
        return f"The shipped choice, {shipped.name}, is not on the Pareto set: {' '.join(reasons)}"

    def _reason(self, better: Choice) -> str:
        """Return why a choice that beats the shipped one is not shipped."""
        known = {"": self.why_not} if isinstance(self.why_not, str) else self.why_not
        found = (known[key] for key in (better.name, better.series, "") if known.get(key))
        return next(found, "No reason is known: a defect.")


def sentences(text: str) -> int:
    """Return the number of sentences of a text."""
    return len(re.findall(r"[.!?](?=\s|$)", text))


def order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Return the order of convergence: the slope of the line through the logarithms of errors over steps."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
