# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a node reports on /diagnostics, for display: state, and what to do about each fault."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

_FAULT: Final = "fault: "
"""Beginning of the keys whose values say what a fault means and what to do."""


@dataclass(frozen=True)
class Diagnosis:
    """Status of one node."""

    name: str
    """Name of the status without the namespace."""
    level: int
    """Level of diagnostic_msgs/DiagnosticStatus: 0 OK, 1 warning, 2 error."""
    text: str
    """State in one line; of the model with what to do."""
    values: dict[str, str] = field(default_factory=dict)
    """Counters and values by name."""

    @property
    def remedies(self) -> dict[str, str]:
        """Faults that are present: what each means and what to do, by its name."""
        return {key.removeprefix(_FAULT): text for key, text in self.values.items() if key.startswith(_FAULT)}


def diagnosis(status: Any, namespace: str) -> Diagnosis | None:
    """Return what a status says about a node in a namespace; None if it is about another.

    Parameters
    ----------
    status : DiagnosticStatus
        One status of a message of /diagnostics.
    namespace : str
        Namespace of the stack, without slashes at its ends.
    """
    if not status.name.startswith(f"{namespace}/"):
        return None
    return Diagnosis(
        name=status.name.removeprefix(f"{namespace}/"),
        level=status.level[0],
        text=status.message,
        values={pair.key: pair.value for pair in status.values},
    )
