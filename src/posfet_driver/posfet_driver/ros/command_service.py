# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The service `command`: it answers when the board has responded, and keeps nobody waiting meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Final

from posfet_driver.board.command_queue import CommandError
from posfet_driver.protocol.messages import Command, Response
from posfet_model.ros.supervision import SupervisedNode, named
from posfet_msgs.srv import BoardCommand

RESPONSE_TIMEOUT: Final = 0.5
"""Time within which a board has to respond to a command [s]."""
WAITING_LIMIT: Final = 8
"""Number of commands that may wait for their responses; assumed, less than the 10 that the middleware queues."""
CHECK_PERIOD: Final = 0.1
"""Period at which overdue commands are looked for while any waits [s]."""


@dataclass(slots=True, eq=False)
class _Call:
    """A request whose response has not been sent."""

    pending: Future[Response]
    response: BoardCommand.Response
    header: object
    deadline: float
    """Monotonic time at which it is answered without the board [s]."""
    answered: bool = False


class CommandService:
    """Serves `command`: submits requests to the board, and answers from the executor once their futures are done.

    An executor sends what a service callback returns as soon as it returns, and rclpy 7.1's EventsExecutor awaits no
    coroutine and knows no guard condition. So the response to a pending command is kept back in `send_response`, which
    every executor calls, together with the header that it belongs to.

    Parameters
    ----------
    node : SupervisedNode
        Node of the service.
    submit : callable
        Submits a command with its argument and time-out [s], and returns the future of the response; may raise
        CommandError.
    """

    def __init__(self, node: SupervisedNode, submit: Callable[[Command, int, float], Future[Response]]) -> None:
        self._node = node
        self._submit = submit
        self._submitted: Future[Response] | None = None  # by the callback that is about to return
        self._calls: list[_Call] = []
        service = node.create_service(BoardCommand, "command", self._call)
        self._send: Callable[[BoardCommand.Response, object], None] = service.send_response
        service.send_response = self._send_later
        self._check_soon = node.internal_errors.guarded("service command", self._check_calls)
        self._timer = node.create_timer(CHECK_PERIOD, self._check_calls, autostart=False)

    def _call(self, request: BoardCommand.Request, response: BoardCommand.Response) -> BoardCommand.Response:
        """Submit a command; return the response at once only when it is refused."""
        self._submitted = None
        try:
            command = Command(request.command)
        except ValueError:
            known = ", ".join(f"{command} {command.name}" for command in Command)
            response.message = f"command must be one of {known}, got {request.command}"
            return response
        try:
            if len(self._calls) >= WAITING_LIMIT:
                raise CommandError(f"{command.name}: {len(self._calls)} commands are waiting already")
            self._submitted = self._submit(command, request.argument, RESPONSE_TIMEOUT)
        except CommandError as error:
            response.message = str(error)
        return response

    def _send_later(self, response: BoardCommand.Response, header: Any) -> None:
        """Send a refusal at once, and keep the response to a pending command."""
        pending, self._submitted = self._submitted, None
        if pending is None:
            self._send(response, header)
            return
        if not self._calls:
            self._timer.reset()
        self._calls.append(_Call(pending, response, header, time.monotonic() + 2 * RESPONSE_TIMEOUT))
        pending.add_done_callback(self._wake)

    def _wake(self, _: object) -> None:
        """Have the executor answer; runs in the data thread."""
        executor = self._node.executor
        if executor is not None:
            executor.create_task(self._check_soon)

    def _check_calls(self) -> None:
        """Answer the calls whose commands are done or overdue."""
        now = time.monotonic()
        for call in self._calls:
            if not call.answered and (call.pending.done() or now >= call.deadline):
                call.answered = True
                self._answer(call)
        # An overdue command is still in the board's queue: it counts until it is done.
        self._calls = [call for call in self._calls if not (call.answered and call.pending.done())]
        if not self._calls:
            self._timer.cancel()

    def _answer(self, call: _Call) -> None:
        response = call.response
        try:
            if call.pending.done():
                response.value = call.pending.result().value
                response.success = True
            else:
                response.message = "no response: the data thread is busy"
        except CommandError as error:
            response.message = str(error)
        except Exception as error:
            self._node.internal_errors.add("service command", error)
            response.message = f"internal error, see the log of the node: {named(error)}"
        self._send(response, call.header)
