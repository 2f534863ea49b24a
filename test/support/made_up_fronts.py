# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Small made-up fronts for tests."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.fronts.front import Check, Choice, Front


def choice(series: str, parameter: str, error: float, seconds: float, spread: float = 0.01) -> Choice:
    return Choice(series, parameter, error, tuple(seconds * (1 + spread * k) for k in (-1, 0, 1)))


def front(*choices: Choice, **changes: object) -> Front:
    front = Front(
        "name", "Title", "a unit of work", "error [1]", "the truth", 0.0, choices, choices[0].name,
        (Check("a quantity", 1.0, 0.0, 2.0),), "It is so. Choose it.",
    )  # fmt: skip
    return replace(front, **changes)  # type: ignore[arg-type]


FAST, GOOD = choice("fast", "1 us", 0.1, 1e-6), choice("good", "2 us", 0.001, 1e-4)
