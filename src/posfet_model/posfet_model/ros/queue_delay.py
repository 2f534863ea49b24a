# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How long messages wait in the queue of the executor, and which of them come too late to be processed.

The EventsExecutor runs its events in the order in which they came. When scans come faster than they can be processed,
the queue grows without limit, and services wait behind it. A timer shows the delay: its event waits in the same queue.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final, Protocol

LONGEST: Final = 1.0
"""Delay from which on scans are dropped [s]: as many as the queue of scans holds at 1 kHz."""

SHORT: Final = 0.2
"""Delay from which on they are processed again [s]."""

BEAT: Final = 0.05
"""Period of the timer [s]."""


class Node(Protocol):
    """The part of a node that is used here."""

    def create_timer(self, timer_period_sec: float, callback: Callable[[], None], *, autostart: bool) -> Any:
        """Return a timer."""


class QueueDelay:
    """Drops messages while the queue of the executor is too long; between `start` and `stop`.

    Parameters
    ----------
    node : Node
        Node whose executor runs the callbacks of the messages.
    clock : callable, optional
        Returns a monotonic time [s].
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._beat = clock()
        self._dropping = False
        self.dropped = 0
        """Number of messages that came too late."""
        self._timer = node.create_timer(BEAT, self._on_beat, autostart=False)

    def start(self) -> None:
        """Begin."""
        self._beat, self._dropping = self._clock(), False
        self._timer.reset()

    def stop(self) -> None:
        """End."""
        self._timer.cancel()

    def too_late(self) -> bool:
        """Return whether the message that the executor has just taken is to be dropped, and count it."""
        self._dropping = self._clock() - self._beat > (SHORT if self._dropping else LONGEST)
        self.dropped += self._dropping
        return self._dropping

    def _on_beat(self) -> None:
        self._beat = self._clock()
