# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The main function of every node: start, spin on the fastest executor, shut down cleanly, report bad input."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from posfet_model.config import ConfigError
from posfet_model.ros import middleware
from posfet_model.ros.exit_codes import INTERRUPTED, InternalError, exit_code
from posfet_model.ros.supervision import RestartPolicy, SupervisedNode, described

try:
    from rclpy.experimental import EventsExecutor as NodeExecutor
except ImportError:  # rclpy before Jazzy's
    from rclpy.executors import SingleThreadedExecutor as NodeExecutor

POLL = 0.1
"""Longest delay between a stop requested by a signal or by `until` and the end of spinning [s]."""


class SignalHandler:
    """Handles SIGINT and SIGTERM: interrupts before nodes spin, requests a clean stop afterwards.

    The handlers of rclpy would shut the context down while other threads publish, and raise within callbacks.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin to start up."""
        self.stop_requested = False
        self.repeated = False
        """Whether the start-up was interrupted more than once."""
        self.spinning = False
        self.deferred = False
        """Whether a signal only requests a stop, instead of raising KeyboardInterrupt."""

    def __call__(self, _signal: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self.repeated = self.stop_requested and not self.spinning
        self.stop_requested = True
        if not self.deferred:
            self.deferred = True  # the next one must not interrupt the clean-up
            raise KeyboardInterrupt


_signals = SignalHandler()


def spin(nodes: Sequence[Node], until: Callable[[], bool] = lambda: False) -> None:
    """Run the callbacks of `nodes` in this thread until Ctrl-C, SIGTERM, shutdown, or until `until()` is true.

    `until` is called after each callback and at least every `POLL` seconds. For use within `ros`. An exception of a
    callback that no node handles itself is counted and logged; a second one within a minute ends the run.

    Parameters
    ----------
    nodes : sequence of Node
        Nodes whose callbacks are run.
    until : callable, optional
        Condition that ends the run; default: none.

    Raises
    ------
    InternalError
        When a node cannot go on, or callbacks raise again and again.
    """
    _signals.deferred = _signals.spinning = True
    supervised = [node for node in nodes if isinstance(node, SupervisedNode)]
    restarts = RestartPolicy()
    # Objects made so far live until the end: the garbage collector need not scan them and pause the data thread.
    gc.freeze()
    executor = NodeExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        # Not executor.spin(): for a wait without a limit libstdc++ 12 computes a time-out in the past, and the
        # EventsExecutor of rclpy 7.1 then spins in a busy loop with its queue locked.
        while rclpy.ok() and not _signals.stop_requested and not until():
            for node in supervised:
                if node.failure:
                    raise InternalError(node.failure)
            try:
                executor.spin_once(POLL)
            except ExternalShutdownException:
                raise
            except Exception as error:
                for node in supervised[:1]:
                    node.internal_errors.add("callback", error)
                if not (supervised and restarts.allows()):
                    raise InternalError(f"a callback failed: {described(error)}") from error
    except ExternalShutdownException:
        pass
    finally:
        executor.shutdown()


@contextmanager
def ros(arguments: Sequence[str] | None = None) -> Iterator[ExitStack]:
    """Run the block with rclpy initialised, and shut down cleanly on Ctrl-C and SIGTERM.

    Parameters
    ----------
    arguments : sequence of str, optional
        ROS command line; that of the process by default.

    Yields
    ------
    ExitStack
        For callbacks that must run before rclpy shuts down, such as `destroy_node`.

    Raises
    ------
    ConfigError
        If the ROS command line or a parameter file cannot be read.
    SystemExit
        With `INTERRUPTED`, after the clean-up, if the start-up was interrupted twice.
    """
    try:
        given = None if arguments is None else list(arguments)
        with middleware.applied():
            rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise ConfigError(f"unknown ROS arguments: {error}") from error
    except rclpy_implementation.RCLError as error:
        raise ConfigError(" ".join(str(error).split())) from error
    _signals.reset()
    with ExitStack() as stack:
        stack.callback(setattr, sys, "unraisablehook", sys.unraisablehook)
        sys.unraisablehook = partial(_quiet_when_interrupted, sys.unraisablehook)
        for number in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, number, signal.signal(number, _signals))
        stack.callback(rclpy.try_shutdown)
        try:
            yield stack
        except KeyboardInterrupt:
            pass
        except (ParameterException, rclpy_implementation.RCLInvalidROSArgsError) as error:
            raise ConfigError(" ".join(str(error).split())) from error
        finally:
            _signals.deferred = True  # a second Ctrl-C (launch sends one after the terminal) must not stop the clean-up
    if _signals.repeated:
        raise SystemExit(INTERRUPTED)


def _quiet_when_interrupted(report: Callable[[Any], object], unraisable: Any) -> None:
    """Report what Python cannot raise, but no KeyboardInterrupt: the stop is requested anyway."""
    if not isinstance(unraisable.exc_value, KeyboardInterrupt):
        report(unraisable)


def run_node(make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Run one node until Ctrl-C or SIGTERM and return the exit code of the process.

    Parameters
    ----------
    make_node : callable
        Returns the node; may raise ConfigError.
    arguments : sequence of str, optional
        ROS command line; that of the process by default.

    Returns
    -------
    int
        0 after a clean shutdown; 1, with one line on stderr, if a file or parameter cannot be used; `PROCESS_FAILED`,
        with one line, when the node cannot go on after internal errors.
    """

    def run() -> int:
        with ros(arguments) as stack:
            node = make_node()
            stack.callback(node.destroy_node)
            spin([node])
        return 0

    return exit_code(run)
