# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the browser view needs to know of a stack, wherever it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from posfet.snapshot import SnapshotSource

if TYPE_CHECKING:
    from posfet.array_view import ArrayView
    from posfet.diagnosis import Diagnosis


class Client(Protocol):
    """Description, diagnostics and services of a stack, as `posfet.stack_client.StackClient` has them."""

    namespace: str
    array: ArrayView | None

    @property
    def diagnoses(self) -> dict[str, Diagnosis]:
        """Newest status of each node, by name."""
        ...

    def actions(self) -> tuple[str, ...]:
        """Return the services that somebody serves."""
        ...

    def request(self, action: str, argument: str | bool, done: Callable[[bool, str], object]) -> None:
        """Call a service; `done` takes success and message, in any thread."""
        ...


class Recordings(Protocol):
    """Recordings of one sensor, as `posfet.web.recording.Recording` makes them."""

    @property
    def running(self) -> bool:
        """Whether a recording goes on."""
        ...

    def start(self) -> str:
        """Begin to record, and return where; ConfigError, one line, if that is not possible."""
        ...

    def stop(self) -> str:
        """End the recording, and return its summary; ConfigError, one line, if it failed or there is none."""
        ...


@dataclass(frozen=True)
class Viewed:
    """One sensor in the browser."""

    client: Client
    snapshots: SnapshotSource
    """Called in a thread of its own."""
    recordings: Recordings | None = None
    """None: the page does not offer to record."""

    def actions(self) -> tuple[str, ...]:
        """Return what the page can do: the services that somebody serves, and ``record``."""
        return (*self.client.actions(), *(["record"] if self.recordings else []))
