# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Display a running stack from its topics: `posfet view`."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from posfet.display_loop import show
from posfet.screen import Screen
from posfet.snapshot import ContactView, Snapshot, TrueContact
from posfet_model.command_line import checked_namespace, positive
from posfet_model.contacts.tracker import ContactState
from posfet_model.ros.exit_codes import exit_code
from posfet_model.ros.run_node import ros
from posfet_msgs.msg import TactileContacts, TactileImage, TactileTruth

HISTORY = 100
"""Messages kept per topic, until those of the same scan arrive on the other topics."""


class ViewNode(Node):  # type: ignore[misc]  # rclpy has no types
    """Keeps the newest messages of one stack, and converts them only when a snapshot is requested.

    Losses are read from the diagnostics: a message that this node misses is not a loss of the stack.

    Parameters
    ----------
    namespace : str
        Namespace of the stack.
    ros_words : sequence of str, optional
        ROS arguments of the stack, which may rename its topics.
    """

    def __init__(self, namespace: str, ros_words: Sequence[str] = ()) -> None:
        super().__init__("view_node", namespace=namespace, cli_args=[*ros_words], use_global_arguments=False)
        self._image: TactileImage | None = None
        self._contacts: dict[int, TactileContacts] = {}
        self._truth: dict[int, TactileTruth] = {}
        self._state = ""
        self._calibration = ""
        self._frames_lost = 0
        self._scans_lost = 0
        self._first_sequence: int | None = None
        depth = 100
        self.create_subscription(TactileImage, "image", self._take_image, depth)
        self.create_subscription(TactileContacts, "contacts", self._take_contacts, depth)
        self.create_subscription(TactileTruth, "truth", self._take_truth, depth)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, depth)

    def snapshot(self) -> Snapshot | None:
        """Return the newest snapshot, or None before the first image and contacts."""
        image = self._image
        common = self._contacts.keys() & self._truth.keys() or self._contacts.keys()
        if image is None or not common:
            return None
        sequence = max(common)
        contacts = self._contacts[sequence]
        return Snapshot(
            time=time.monotonic(),
            scans=int(image.sequence) - (self._first_sequence or 0) + 1 - self._scans_lost,
            frames_lost=self._frames_lost,
            scans_lost=self._scans_lost,
            rows=image.rows,
            cols=image.cols,
            force=np.asarray(image.force),
            total_force=image.total_force,
            data_valid=contacts.data_valid,
            contacts=tuple(_view(contact) for contact in contacts.contacts if contact.state != ContactState.RELEASED),
            truth=_true_contacts(self._truth.get(sequence)),
            state=self._state,
            calibration=self._calibration,
        )

    def state(self) -> str:
        """Return the state of the source of scans, in one line."""
        return self._state or f"nothing on {self.get_namespace()}/image and {self.get_namespace()}/contacts"

    def _take_image(self, message: TactileImage) -> None:
        if self._image is None or message.sequence <= self._image.sequence:  # the first image, or the board restarted
            self._first_sequence = int(message.sequence)
            self._contacts.clear()
            self._truth.clear()
        self._image = message

    def _take_contacts(self, message: TactileContacts) -> None:
        _keep(self._contacts, message)

    def _take_truth(self, message: TactileTruth) -> None:
        _keep(self._truth, message)

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if not status.name.startswith(f"{self.get_namespace().strip('/')}/"):
                continue
            if "frames lost" in values:
                self._state = status.message
                # With an emulated adapter the simulated board reports 0 and the driver the losses: keep the larger.
                self._frames_lost = max(self._frames_lost, int(values["frames lost"]))
            self._calibration = values.get("calibration", self._calibration)
            if "missed" in values:
                self._scans_lost = int(values["missed"])


def _keep(messages: dict[int, Any], message: Any) -> None:
    """Keep the newest messages by sequence, to match those of one scan."""
    messages[message.sequence] = message
    if len(messages) > HISTORY:
        del messages[next(iter(messages))]


def _view(contact: Any) -> ContactView:
    return ContactView(
        id=contact.id,
        state=ContactState(contact.state).name.lower(),
        x=contact.centre_of_pressure.x,
        y=contact.centre_of_pressure.y,
        force=-contact.force.z,
        standard_deviation=contact.normal_force_deviation,
        area=contact.area,
        age=contact.age.sec + contact.age.nanosec * 1e-9,
    )


def _true_contacts(truth: TactileTruth | None) -> tuple[TrueContact, ...]:
    if truth is None:
        return ()
    touching = zip(truth.contact_centres, truth.contact_forces, strict=True)
    return tuple(TrueContact(centre.x, centre.y, force) for centre, force in touching)


def main(words: Sequence[str] | None = None) -> int:
    """Run `posfet view` and return the exit code."""
    parser = argparse.ArgumentParser(prog="posfet view", description="Show the live force map of a running stack.")
    parser.add_argument("--namespace", default="tactile", help="namespace of the sensor (default: tactile)")
    parser.add_argument("--for", dest="seconds", type=positive, default=math.inf, help="stop after this many seconds")
    options = parser.parse_args(words)

    def run() -> int:
        namespace = checked_namespace(options.namespace)
        with ros([]) as stack:
            node = ViewNode(namespace)
            stack.callback(node.destroy_node)
            with Screen(node) as screen:
                return show(screen, [node], options.seconds, node.state)
        return 0

    return exit_code(run)
