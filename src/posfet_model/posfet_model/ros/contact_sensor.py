# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts for a controller that asks for them in its own loop, like a semantic component of ros2_control."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Final

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from posfet_model._lib.units import NANOSECONDS
from posfet_msgs.msg import TactileContact, TactileContacts

DRIFT: Final = 2e-4
"""Largest difference between the rates of two clocks; assumed, more than that of two quartz oscillators."""


class ContactSensor:
    """Holds the newest contacts of one sensor; they are unknown unless they are valid and fresh.

    Their age is the time since they arrived, and that by which they arrived later than the quickest ones, by their
    stamps: contacts that waited on their way are old, as behind a model that cannot keep up. The clocks of hosts need
    not agree. A recording that is played slower than in real time becomes old.

    Parameters
    ----------
    node : Node
        Node of the controller, whose executor receives the messages.
    namespace : str
        Namespace of the sensor, relative to that of the node unless it begins with a slash.
    max_age : float
        Age up to which a message counts [s].
    clock : callable
        Steady clock [s].
    """

    def __init__(
        self, node: Node, namespace: str, max_age: float = 0.05, clock: Callable[[], float] = time.monotonic
    ) -> None:
        if not 0.0 < max_age < math.inf:
            raise ValueError(f"max_age must be in (0, inf), got {max_age}")
        self._newest = TactileContacts()  # not valid
        self._arrival = -math.inf
        self._stamp = 0  # of the newest message [ns]
        self._delay = 0.0  # of the newest message, in comparison with the quickest one [s]
        self._max_age, self._clock = max_age, clock
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # fits publishers of either reliability
        node.create_subscription(TactileContacts, f"{namespace}/contacts", self._take, newest)

    @property
    def known(self) -> bool:
        """Whether the contacts are known: the newest message is valid, and not older than `max_age`."""
        return bool(self._newest.data_valid) and self.age <= self._max_age

    @property
    def age(self) -> float:
        """Age of the newest message [s]; inf before it."""
        return self._clock() - self._arrival + self._delay

    @property
    def frame_id(self) -> str:
        """Frame of the array; '' before the first message."""
        return str(self._newest.header.frame_id)

    def contacts(self) -> tuple[TactileContact, ...] | None:
        """Return what touches now, without released contacts; None if that is unknown, which is not the empty tuple."""
        if not self.known:
            return None
        return tuple(each for each in self._newest.contacts if each.state != TactileContact.STATE_RELEASED)

    def force(self) -> tuple[float, float, float]:
        """Return the sum of the forces of all contacts on the sensor [N], in the frame of the array; NaN if unknown."""
        contacts = self.contacts()
        if contacts is None:
            return math.nan, math.nan, math.nan
        x, y, z = (sum(getattr(each.force, axis) for each in contacts) for axis in "xyz")
        return float(x), float(y), float(z)

    def _take(self, message: TactileContacts) -> None:
        arrival = self._clock()
        stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        between, measured = arrival - self._arrival, (stamp - self._stamp) / NANOSECONDS
        if math.isinf(between) or measured < 0.0:  # the first, its clock was set, or a recording begins again
            self._delay = 0.0
        else:
            self._delay = max(self._delay + (1.0 - DRIFT) * between - measured, 0.0)
        self._newest, self._arrival, self._stamp = message, arrival, stamp
