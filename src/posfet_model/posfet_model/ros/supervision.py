# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a process does about its own errors: count them, restart what has ended once, and end when that did not help."""

from __future__ import annotations

import inspect
import math
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from posfet_model.config import did_you_mean

RESTART_PERIOD: Final = 60.0
"""Time in which one restart is tried [s]; a second error within it ends the process."""


LONGEST: Final = 200
"""Length of an exception's text from which on it is shortened."""


def named(error: BaseException) -> str:
    """Return type and text of an exception on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:LONGEST]}".removesuffix(": ")


def described(error: BaseException) -> str:
    """Return type, text and place of an exception on one line."""
    frames = traceback.extract_tb(error.__traceback__)
    return named(error) + (f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else "")


class RestartPolicy:
    """Allows one restart within `RESTART_PERIOD`."""

    def __init__(self) -> None:
        self._last = -math.inf

    def allows(self) -> bool:
        """Return whether to restart after an error that has happened now."""
        now = time.monotonic()
        before, self._last = self._last, now
        return now - before >= RESTART_PERIOD


class InternalErrors:
    """Counts exceptions that nobody expected, by cause; they end neither the callbacks' executor nor the data path.

    Parameters
    ----------
    log : callable
        Logs an error; called once for errors of a cause that follow each other and are alike.
    """

    def __init__(self, log: Callable[[str], object]) -> None:
        self.counts: dict[str, int] = {}
        """Number of errors by cause."""
        self.latest = ""
        """The newest error in one line; '' before the first."""
        self._log = log
        self._logged: dict[str, str] = {}
        self._lock = threading.Lock()

    @property
    def total(self) -> int:
        """Number of errors of any cause."""
        return sum(self.counts.values())

    def add(self, cause: str, error: BaseException | str) -> None:
        """Count and log an error.

        Parameters
        ----------
        cause : str
            What raised it, such as "service scene/load".
        error : BaseException or str
            The error, logged with its traceback, or its text in one line.
        """
        text = error if isinstance(error, str) else described(error)
        with self._lock:  # readers need none: they see either mapping
            self.counts = {**self.counts, cause: self.counts.get(cause, 0) + 1}
        self.latest = f"{cause}: {text}"
        if self._logged.get(cause) != text:
            self._logged[cause] = text
            if isinstance(error, BaseException):
                text = "\n" + "".join(traceback.format_exception(error)).rstrip()
            self._log(f"{cause}: {text}")

    def values(self) -> dict[str, str]:
        """Return the errors for diagnostics, by key; nothing before the first."""
        if not self.latest:
            return {}
        by_cause = {f"errors of {cause}": str(count) for cause, count in self.counts.items()}
        return {"internal errors": str(self.total), **by_cause, "latest internal error": self.latest}

    def guarded(self, cause: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback of a timer or service that counts its exceptions; a service then answers with the error.

        Parameters
        ----------
        cause : str
            Name of the callback.
        callback : callable
            The callback; may be a coroutine.
        """

        def failed(error: Exception, arguments: tuple[Any, ...]) -> Any:
            self.add(cause, error)
            response = type(arguments[-1])() if arguments else None  # nothing of a half-filled one
            if response is not None and hasattr(response, "message"):
                response.message = f"internal error, see the log of the node: {named(error)}"
            return response

        async def later(*arguments: Any) -> Any:
            try:
                return await callback(*arguments)
            except Exception as error:
                return failed(error, arguments)

        def now(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except Exception as error:
                return failed(error, arguments)

        return later if inspect.iscoroutinefunction(callback) else now


class SupervisedNode(Node):  # type: ignore[misc]  # rclpy has no types
    """A node whose timers and services may raise: the error is counted, and ends neither the executor nor the process.

    Parameters
    ----------
    *arguments
        Arguments of the next class, rclpy's Node.
    **named_arguments
        Further arguments of it.
    """

    def __init__(self, *arguments: Any, **named_arguments: Any) -> None:
        self.internal_errors = InternalErrors(self._log_error)
        """Errors of this node."""
        self.failure = ""
        """Why this node cannot go on, in one line: `spin` then ends the process; '' while it can."""
        self.fixed_parameters: dict[str, str] = {}
        """Parameters that cannot change while the node runs, by name, and why."""
        super().__init__(*arguments, **named_arguments)

    def set_parameters(self, parameter_list: list[Any]) -> list[Any]:
        """Set parameters one by one as rclpy does; see `set_parameters_atomically`."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Any]) -> Any:
        """Set all parameters or none as rclpy does; the result says which does not exist, or why one cannot change."""
        names = [parameter.name for parameter in parameter_list]
        reasons = [self._no_such_parameter(name) for name in names if not self.has_parameter(name)]
        reasons += [
            f"{parameter.name}: cannot change while the node runs: {self.fixed_parameters[parameter.name]}"
            for parameter in parameter_list
            if parameter.name in self.fixed_parameters
        ]
        if reasons:
            return SetParametersResult(successful=False, reason="; ".join(reasons))
        return super().set_parameters_atomically(parameter_list)

    def _no_such_parameter(self, name: str) -> str:
        similar = did_you_mean(name, self.get_parameters_by_prefix(""))
        return f"{name}: no such parameter, {similar}".rstrip(", ")

    def create_service(self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **options: Any) -> Any:
        """Create a service as rclpy does; when its callback raises, it answers with the error."""
        guarded = self.internal_errors.guarded(f"service {srv_name}", callback)
        return super().create_service(srv_type, srv_name, guarded, **options)

    def create_timer(self, period: float, callback: Callable[..., Any], *options: Any, **named_options: Any) -> Any:
        """Create a timer as rclpy does; it goes on when its callback raises, and while simulated time stands still."""
        guarded = self.internal_errors.guarded(f"timer {callback.__name__.strip('_')}", callback)
        clock = named_options.pop("clock", None) or Clock(clock_type=ClockType.STEADY_TIME)
        return super().create_timer(period, guarded, *options, clock=clock, **named_options)

    def _log_error(self, text: str) -> None:
        if self.context.ok():  # else the process is shutting down, and errors follow from that
            self.get_logger().error(text)
