# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Commands to a board: queued by any thread, sent by the thread that reads the bus."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field

from posfet_driver.protocol.messages import Command, Response
from posfet_model._lib.units import NANOSECONDS


class CommandError(Exception):
    """A board did not execute a command; the message is one line with the reason."""


@dataclass(slots=True)
class PendingCommand:
    """A command without a response."""

    command: Command
    argument: int
    timeout: float
    """Time in which the response has to arrive [s]."""
    deadline: int
    """Monotonic time at which it expires [ns]."""
    tag: int | None = None
    """Tag with which it was sent; None: not sent yet."""
    response: Future[Response] = field(default_factory=Future)


class CommandQueue:
    """Commands in the order of their submission; one at a time waits for its response."""

    def __init__(self) -> None:
        self._waiting: deque[PendingCommand] = deque()
        self._current: PendingCommand | None = None

    def put(self, command: Command, argument: int, timeout: float, now: int) -> Future[Response]:
        """Add a command; may be called from any thread.

        Parameters
        ----------
        command : Command
            The command.
        argument : int
            Its argument.
        timeout : float
            Time in which the response has to arrive [s].
        now : int
            Monotonic time [ns].

        Returns
        -------
        Future of Response
            Raises CommandError when the command fails. A command that waits can be cancelled, and is not sent then.
        """
        pending = PendingCommand(command, argument, timeout, now + round(timeout * NANOSECONDS))
        self._waiting.append(pending)
        return pending.response

    def next(self) -> PendingCommand | None:
        """Return the command to be sent now, or None; one that was cancelled meanwhile is dropped."""
        while self._current is None and self._waiting:
            pending = self._waiting.popleft()
            if pending.response.set_running_or_notify_cancel():  # from now on it cannot be cancelled
                self._current = pending
                return pending
        return None

    def pending(self) -> bool:
        """Return whether a command is queued or waits for its response."""
        return self._current is not None or bool(self._waiting)

    def complete(self, response: Response) -> PendingCommand | None:
        """Complete the command that `response` belongs to and return it; None when none waits for it any more."""
        pending = self._current
        if pending is None or response.tag != pending.tag or response.command != pending.command:
            return None
        self._current = None
        if response.confirms(pending.argument):
            pending.response.set_result(response)
        else:
            _fail(pending, f"refused by the board: {response.reason}")
        return pending

    def expire(self, now: int, reason: str) -> None:
        """Fail the commands whose deadline has passed at `now` [ns]; `reason` is why they could not be sent.

        Parameters
        ----------
        now : int
            Monotonic time [ns].
        reason : str
            Why waiting commands could not be sent, for their error messages.
        """
        if self._current is not None and now >= self._current.deadline:
            pending, self._current = self._current, None
            _fail(pending, f"no response within {pending.timeout:g} s")
        while self._waiting and now >= self._waiting[0].deadline:
            pending = self._waiting.popleft()
            _fail(pending, f"the board was not ready within {pending.timeout:g} s: {reason}")

    def fail(self, reason: str) -> None:
        """Fail all commands."""
        if self._current is not None:
            pending, self._current = self._current, None
            _fail(pending, reason)
        while self._waiting:
            _fail(self._waiting.popleft(), reason)


def _fail(pending: PendingCommand, reason: str) -> None:
    if not pending.response.running() and not pending.response.set_running_or_notify_cancel():
        return  # cancelled
    pending.response.set_exception(CommandError(f"{pending.command.name}: {reason}"))
