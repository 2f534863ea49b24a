"""How far behind its time a simulated board may fall: what is older is missed, as by a board that is too slow."""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import Frame
from posfet_model._lib.units import NANOSECONDS
from posfet_sim.emulation.bus_node import Node

LATE: Final = 0.1
"""Delay of a scan [s] from which it carries STATUS_SCAN_OVERRUN."""
LONGEST_BACKLOG: Final = 0.5
"""Delay of a scan [s] from which all that are due are missed but the newest: a stop of this process, or a machine that
is too slow, delays no scan by more. Shorter delays, which other work on the machine causes, lose none. Assumed."""
AT_ONCE: Final = 0.05
"""Time of the scans that are sent before the next look at what has arrived [s]: a command waits no longer. Assumed."""


def first_due(node: Node, now: int) -> list[Frame]:
    """Return the first of the frames that are due at `now` [ns]: all, unless the node is late by more than AT_ONCE.

    Parameters
    ----------
    node : Node
        Sender of the frames.
    now : int
        Monotonic time [ns].

    Returns
    -------
    list of Frame
        Frames in the order in which they are sent, of whole scans.
    """
    end = node.next_due() + round(AT_ONCE * NANOSECONDS)
    return node.due(now, end) if end < now else node.due(now)
