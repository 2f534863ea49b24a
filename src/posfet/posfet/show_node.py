"""Keeps the screen up to date while nodes run, and closes with the summary."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

from rclpy.node import Node

from posfet.screen import Screen
from posfet_model.ros.run_node import spin

NO_SCAN = 1


def show(
    screen: Screen,
    nodes: Sequence[Node],
    seconds: float,
    state: Callable[[], str],
    stop: Callable[[], bool] = lambda: False,
) -> int:
    """Spin `nodes` and keep `screen` up to date for `seconds` [s], until Ctrl-C or `stop()`; return the exit code.

    1 with the reason on stderr when the time is over and no scan has come.
    """
    end = time.monotonic() + seconds

    def over() -> bool:
        screen.update()
        return time.monotonic() >= end or stop()

    spin(nodes, until=over)
    screen.close()
    print(screen.record.summary())
    if screen.record.last is None and time.monotonic() >= end:
        print(f"posfet: {state()}", file=sys.stderr)
        return NO_SCAN
    return 0
