# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How far behind its time a simulated board may fall: what is older is missed, as by a board that is too slow."""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import Frame
from posfet_model._lib.units import NANOSECONDS
from posfet_sim.emulation.bus_node import Node

LATE: Final = 0.1
"""Delay of a scan [s] from which it carries STATUS_SCAN_OVERRUN."""
LONGEST_BACKLOG: Final = 0.5
"""Delay of a scan [s] from which it is missed; in classic frames, all but the newest are. A machine that is too slow so
thins scans out: forces can be followed across many short gaps, not across a few long ones. Shorter delays, which other
work causes, lose none. Assumed."""
STOPPED: Final = 1.0
"""Delay of a scan [s] from which all that are due are missed but the newest: this process did not run. Assumed."""
LATE_STEP: Final = 0.2
"""Time that passes in one step of the simulation while scans are missed [s]: a step takes as long to compute as a scan,
which is a fifth of that where a machine is 40 times too slow for 1 kHz. Assumed."""
AT_ONCE: Final = 0.005
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
