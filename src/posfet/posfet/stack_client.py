# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a display wants from a running stack besides its data: description, diagnostics, services."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from posfet.array_view import ArrayView, array_view
from posfet.diagnosis import Diagnosis, diagnosis
from posfet_msgs.msg import TactileInfo
from posfet_msgs.srv import CalibrationFile, LoadScene, Tare

SERVICES: Final[dict[str, tuple[Any, str]]] = {
    "tare": (Tare, "force"),
    "scene/load": (LoadScene, "scene"),
    "calibration/load": (CalibrationFile, "path"),
    "calibration/save": (CalibrationFile, "path"),
}
"""Services that a display may call: type, and the one field of the request."""
DEPTH: Final = 10
OVERDUE: Final = 5.0
"""Time without a report, of which there is one per second, after which a status counts as old [s]."""
ERROR: Final = 2
"""Level of an old status."""


class StackClient:
    """Follows `info` and `/diagnostics` of one stack and calls its services; costs a few messages a second.

    Parameters
    ----------
    node : Node
        Node of the display, with the ROS arguments of the stack; it must be spun.
    namespace : str
        Full namespace of the stack, without slashes at its ends.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        self.node = node
        """Node of the display."""
        self.namespace = namespace
        self.array: ArrayView | None = None
        """Description of the array; None before the first scan."""
        self._reports: dict[str, tuple[float, Diagnosis]] = {}  # arrival [s] and status; replaced, never changed
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(TactileInfo, "info", self._take_info, latched)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, DEPTH)
        self._callers: dict[str, Client] = {
            name: node.create_client(kind, name) for name, (kind, _) in SERVICES.items()
        }

    @property
    def diagnoses(self) -> dict[str, Diagnosis]:
        """Newest status of each node, by name; one that has not reported for `OVERDUE` is an error, and says so."""
        now = time.monotonic()
        return {name: _aged(found, now - arrival) for name, (arrival, found) in self._reports.items()}

    @property
    def state(self) -> str:
        """State of the source of scans in one line; '' while unknown."""
        return next((each.text for each in self.diagnoses.values() if "frames lost" in each.values), "")

    @property
    def frames_lost(self) -> int:
        """CAN frames lost: with an emulated adapter the board reports 0 and the driver the losses, so the larger."""
        return max((int(each.values.get("frames lost", 0)) for each in self.diagnoses.values()), default=0)

    @property
    def scans_lost(self) -> int:
        """Scans that did not reach the model."""
        return max((int(each.values.get("missed", 0)) for each in self.diagnoses.values()), default=0)

    @property
    def calibration(self) -> str:
        """Date of the calibration, or what its absence costs; '': not reported."""
        return next(
            (each.values["calibration"] for each in self.diagnoses.values() if "calibration" in each.values), ""
        )

    def actions(self) -> tuple[str, ...]:
        """Return the names in `SERVICES` that somebody serves; for any thread."""
        return tuple(name for name, caller in self._callers.items() if caller.service_is_ready())

    def request(self, action: str, argument: str | bool, done: Callable[[bool, str], object]) -> None:
        """Call a service; `done` is called with success and message in the thread that spins this node.

        Parameters
        ----------
        action : str
            Name in `SERVICES`.
        argument : str or bool
            Value of the request's field.
        done : callable
            Takes the answer.
        """
        kind, name = SERVICES[action]
        caller = self._callers.get(action)
        if caller is None or not caller.service_is_ready():
            done(False, f"{action}: nobody serves it; is the stack still running?")
            return
        future = caller.call_async(kind.Request(**{name: argument}))

        def answer(finished: Any) -> None:
            response = finished.result()
            done(response.success, response.message)

        future.add_done_callback(answer)

    def _take_info(self, message: TactileInfo) -> None:
        self.array = array_view(message)

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        found = [diagnosis(status, self.namespace) for status in message.status]
        now = time.monotonic()
        self._reports = {**self._reports, **{each.name: (now, each) for each in found if each is not None}}


def _aged(found: Diagnosis, age: float) -> Diagnosis:
    """Return a status that arrived `age` [s] ago."""
    if age < OVERDUE:
        return found
    return replace(found, level=ERROR, text=f"no report for {age:.0f} s; the last one: {found.text}")
