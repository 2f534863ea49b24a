"""The main function of every node: start, spin on the fastest executor there is, end cleanly, report bad input."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from posfet_model.config import ConfigError

try:
    from rclpy.experimental import EventsExecutor as NodeExecutor
except ImportError:  # rclpy before Jazzy's
    from rclpy.executors import SingleThreadedExecutor as NodeExecutor

NODE_ERROR = 1

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable with the settings of the middleware, Fast DDS; what a user has set stays."""
MIDDLEWARE = Path(__file__).with_name("middleware.xml")

POLL = 0.1
"""Longest time that an end asked for by a signal or by `until` waits for its turn [s]."""


class Ending:
    """What SIGINT and SIGTERM do: before nodes spin they interrupt, from then on they ask for an orderly end.

    rclpy's own handlers would shut the context down under threads that publish, and raise in the middle of callbacks.
    """

    def __init__(self) -> None:
        self.asked = False
        self.orderly = False

    def __call__(self, _signal: int, _frame: FrameType | None) -> None:
        """Take a signal."""
        self.asked = True
        if not self.orderly:
            raise KeyboardInterrupt


_ending = Ending()


def spin(nodes: Sequence[Node], until: Callable[[], bool] = lambda: False) -> None:
    """Serve the callbacks of `nodes` in this thread until Ctrl-C, SIGTERM, shutdown, or until `until()` is true.

    `until` is asked after each callback and at least every `POLL` seconds. For the block of `ros`.
    """
    _ending.orderly = True
    # What was made up to here stays: the garbage collector need not walk through it again and stop the data thread.
    gc.freeze()
    executor = NodeExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        # Not executor.spin(): where its wait has no end, libstdc++ 12 computes a time-out that has passed already, and
        # the EventsExecutor of rclpy 7.1 turns round and round with its queue locked.
        while rclpy.ok() and not _ending.asked and not until():
            executor.spin_once(POLL)
    except ExternalShutdownException:
        pass
    finally:
        executor.shutdown()


@contextmanager
def ros(arguments: Sequence[str] | None = None) -> Iterator[ExitStack]:
    """Run the block with rclpy, and end cleanly on Ctrl-C and SIGTERM.

    Yields a stack for what has to be undone before rclpy shuts down, first of all `destroy_node`. Raises ConfigError
    for a ROS command line or parameter file that cannot be read.
    """
    os.environ.setdefault(PROFILES, str(MIDDLEWARE))
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        raise ConfigError(" ".join(str(error).split())) from error
    _ending.asked = _ending.orderly = False
    with ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, number, signal.signal(number, _ending))
        stack.callback(rclpy.try_shutdown)
        try:
            yield stack
        except KeyboardInterrupt:
            pass
        except (ParameterException, rclpy_implementation.RCLInvalidROSArgsError) as error:
            raise ConfigError(" ".join(str(error).split())) from error
        finally:
            _ending.orderly = True  # a second Ctrl-C, as launch sends one after the terminal's, must not break the end


def run_node(make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Run one node until Ctrl-C or SIGTERM and return the exit code of the process.

    0 after a clean end; 1 with one line on stderr when a file or parameter cannot be used.
    """
    try:
        with ros(arguments) as stack:
            node = make_node()
            stack.callback(node.destroy_node)
            spin([node])
    except ConfigError as error:
        print(error, file=sys.stderr)
        return NODE_ERROR
    return 0
