# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Choose the display, run nodes, update it meanwhile, and print the summary at the end."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rclpy.node import Node

from posfet.lines import Lines
from posfet.snapshot import SnapshotSource
from posfet_model.ros.run_node import spin

if TYPE_CHECKING:
    from posfet.web.viewed import Client

NO_SCAN = 1
PATIENCE = 3.0
"""Time without a scan after which it is said what is waited for [s]."""


def display(source: SnapshotSource, client: Client, link: str = "", outlived: bool = False) -> Lines:
    """Return the live display in a terminal, lines elsewhere.

    Parameters
    ----------
    source : SnapshotSource
        Source of the snapshots.
    client : Client
        Description, diagnostics and services of the stack.
    link : str, optional
        Link to the browser view.
    outlived : bool, optional
        Whether the process goes on when its output, no terminal, cannot be written.
    """
    if not sys.stdout.isatty():
        return Lines(source, outlived=outlived)
    from posfet.terminal.screen import Screen  # noqa: PLC0415  # rich takes a tenth of the start

    return Screen(source, client, link)


def show(
    screen: Lines,
    nodes: Sequence[Node],
    seconds: float,
    state: Callable[[], str],
    stop: Callable[[], bool] = lambda: False,
    awaited: Callable[[], str] = lambda: "",
) -> int:
    """Spin nodes and update the display until the time is over, Ctrl-C, a key, or `stop()`, and return the exit code.

    Parameters
    ----------
    screen : Lines
        Display to update.
    nodes : sequence of Node
        Nodes to spin.
    seconds : float
        Time to run [s]; may be infinite.
    state : callable
        Returns the state of the source of scans in one line, printed if no scan arrived.
    stop : callable
        Returns whether to stop.
    awaited : callable, optional
        Returns what is waited for, in one line, '' for nothing; asked once, some seconds after the start.

    Returns
    -------
    int
        0; 1, with the reason on stderr, if the time is over and no scan has arrived.
    """
    begin = time.monotonic()
    end, ask, said = begin + seconds, begin + PATIENCE, False

    def over() -> bool:
        nonlocal ask, said
        screen.update()
        if screen.problem and not said:
            said = True
            nodes[0].get_logger().warning(f"{screen.problem}; nothing more is printed, the stack goes on")
        if time.monotonic() >= ask:
            ask = math.inf
            if text := awaited():
                screen.waits(text)
        return time.monotonic() >= end or screen.quit or stop()

    spin(nodes, until=over)
    screen.update(math.inf)
    screen.close()
    screen.print(screen.record.summary())
    if screen.record.last is None and time.monotonic() >= end:
        print(f"posfet: {state()}", file=sys.stderr)
        return NO_SCAN
    return 0
