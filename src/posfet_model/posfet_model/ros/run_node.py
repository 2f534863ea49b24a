"""The main function of every node: start, spin on the fastest executor, shut down cleanly, report bad input."""

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
"""Environment variable with the path of the Fast DDS settings; a value set by the user is kept."""
MIDDLEWARE = Path(__file__).with_name("middleware.xml")

POLL = 0.1
"""Longest delay between a stop requested by a signal or by `until` and the end of spinning [s]."""


class SignalHandler:
    """Handles SIGINT and SIGTERM: interrupts before nodes spin, requests a clean stop afterwards.

    The handlers of rclpy would shut the context down while other threads publish, and raise within callbacks.
    """

    def __init__(self) -> None:
        self.stop_requested = False
        self.deferred = False
        """Whether a signal only requests a stop, instead of raising KeyboardInterrupt."""

    def __call__(self, _signal: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self.stop_requested = True
        if not self.deferred:
            raise KeyboardInterrupt


_signals = SignalHandler()


def spin(nodes: Sequence[Node], until: Callable[[], bool] = lambda: False) -> None:
    """Run the callbacks of `nodes` in this thread until Ctrl-C, SIGTERM, shutdown, or until `until()` is true.

    `until` is called after each callback and at least every `POLL` seconds. For use within `ros`.

    Parameters
    ----------
    nodes : sequence of Node
        Nodes whose callbacks are run.
    until : callable, optional
        Condition that ends the run; default: none.
    """
    _signals.deferred = True
    # Objects made so far live until the end: the garbage collector need not scan them and pause the data thread.
    gc.freeze()
    executor = NodeExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        # Not executor.spin(): for a wait without a limit libstdc++ 12 computes a time-out in the past, and the
        # EventsExecutor of rclpy 7.1 then spins in a busy loop with its queue locked.
        while rclpy.ok() and not _signals.stop_requested and not until():
            executor.spin_once(POLL)
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
    """
    os.environ.setdefault(PROFILES, str(MIDDLEWARE))
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        raise ConfigError(" ".join(str(error).split())) from error
    _signals.stop_requested = _signals.deferred = False
    with ExitStack() as stack:
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
        0 after a clean shutdown; 1, with one line on stderr, if a file or parameter cannot be used.
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
