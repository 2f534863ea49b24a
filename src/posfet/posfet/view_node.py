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
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from posfet.array_view import ArrayView
from posfet.display_loop import display, show
from posfet.display_node import display_node
from posfet.hand import read_hand
from posfet.rerun_view import add_rerun_arguments, rerun_view
from posfet.ros_arguments import split
from posfet.snapshot import ContactView, ScanCount, Snapshot, TrueContact
from posfet.stack_client import StackClient
from posfet.web.link import served_link
from posfet.web.options import add_web_arguments, chosen_port
from posfet.web.recording import Recording
from posfet.web.viewed import Viewed
from posfet_model._lib.units import NANOSECONDS
from posfet_model.command_line import positive
from posfet_model.config import ConfigError
from posfet_model.contacts.tracker import ContactState
from posfet_model.ros.exit_codes import exit_code
from posfet_model.ros.run_node import ros
from posfet_msgs.msg import TactileContacts, TactileImage, TactileTruth

_IMAGE: Final = "posfet_msgs/msg/TactileImage"
_SUFFIX: Final = "/view/image"

DEPTH: Final = 10
"""Newest messages taken per topic each time, among which those of one scan are found on all topics."""

TRUTHS: Final = 30
"""True contacts kept, of the last half second: on a loaded machine the model is later than the simulation."""

NEAR: Final = 50
"""Scans by which true contacts may differ from what is shown, where those of the same scan were not taken."""


class ViewNode(Node):  # type: ignore[misc]  # rclpy has no types
    """The newest messages of one stack, taken from its topics for displays when a snapshot is requested.

    It need not be added to an executor, which would run a callback for every message. Losses are read from the
    diagnostics: a message that is not taken is no loss of the stack.

    Parameters
    ----------
    client : StackClient
        Description and diagnostics of the stack.
    ros_words : sequence of str, optional
        ROS arguments of the stack, which may rename its topics.
    """

    def __init__(self, client: StackClient, ros_words: Sequence[str] = ()) -> None:
        super().__init__(
            "view_topics_node",
            namespace=client.namespace,
            cli_args=[*ros_words],
            use_global_arguments=False,
            start_parameter_services=False,
        )
        self.client = client
        self._lock = threading.Lock()
        self._newest: dict[str, deque[Any]] = {}
        self._topics = {}
        self._count = ScanCount()
        profile = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        for topic, kind in (("image", TactileImage), ("contacts", TactileContacts), ("truth", TactileTruth)):
            self._newest[topic] = deque(maxlen=TRUTHS if topic == "truth" else DEPTH)
            self._topics[topic] = self.create_subscription(kind, f"view/{topic}", lambda _: None, profile)

    def snapshot(self) -> Snapshot | None:
        """Return the newest snapshot, or None before the first image and contacts. For any thread."""
        with self._lock:
            for topic, subscription in self._topics.items():
                self._take(topic, subscription)
            return self._snapshot()

    def state(self) -> str:
        """Return the state of the source of scans, in one line; before it is known, what is waited for."""
        return self.client.state or self.awaited()

    def awaited(self) -> str:
        """Return the topics on which nothing has arrived and where there are such topics, in one line; '' if it has."""
        image, contacts = (self._topics[name].topic_name for name in ("image", "contacts"))
        if self.snapshot() is not None:
            return ""
        found = sorted(name for name, kinds in self.get_topic_names_and_types() if _IMAGE in kinds)
        served = [name for name in found if name.endswith(_SUFFIX) and self.count_publishers(name)]
        if image in served:
            where = self.client.state or "it is published there: posfet diagnostics shows the state"
        elif served:
            where = f"running are {', '.join(name.removesuffix(_SUFFIX) for name in served)}"
        else:
            where = "no stack is found: start one with posfet bringup; posfet doctor checks this machine"
        return f"nothing on {image} and {contacts}; {where}"

    def _take(self, topic: str, subscription: Any) -> None:
        """Take the messages that have arrived since the last time, the newest of which the middleware has kept."""
        newest = self._newest[topic]
        with subscription.handle:
            while taken := subscription.handle.take_message(subscription.msg_type, False):
                if newest and taken[0].sequence <= newest[-1].sequence:  # the board restarted
                    newest.clear()
                newest.append(taken[0])

    def _snapshot(self) -> Snapshot | None:
        images, found, truths = (
            {message.sequence: message for message in self._newest[topic]} for topic in ("image", "contacts", "truth")
        )
        common = images.keys() & found.keys()
        if not common:
            return None
        sequence = max(common)
        image, contacts, client = images[sequence], found[sequence], self.client
        near = (each for each in truths.values() if abs(each.sequence - sequence) <= NEAR)
        array = client.array
        live = (contact for contact in contacts.contacts if contact.state != ContactState.RELEASED)
        return Snapshot(
            time=time.monotonic(),
            scans=self._count.update(sequence, client.scans_lost),
            frames_lost=client.frames_lost,
            scans_lost=client.scans_lost,
            rows=image.rows,
            cols=image.cols,
            force=np.asarray(image.force),
            total_force=image.total_force,
            data_valid=contacts.data_valid,
            contacts=tuple(_view(contact, array) for contact in live),
            truth=_true_contacts(min(near, key=lambda each: abs(each.sequence - sequence), default=None)),
            state=client.state,
            calibration=client.calibration,
            standard_deviation=np.asarray(image.standard_deviation),
            status=np.asarray(image.status, np.uint8),
            total_standard_deviation=image.total_force_standard_deviation,
            sequence=sequence,
            stamp=image.header.stamp.sec * NANOSECONDS + image.header.stamp.nanosec,
        )


def _view(contact: Any, array: ArrayView | None) -> ContactView:
    centre, normal = contact.centre_of_pressure, contact.normal
    # The surface's tangents at the contact: a chip is bent around one axis, so that x or y of the normal is 0.
    along_x, along_y = (math.sqrt(1 - normal.x**2), 0.0, -normal.x), (0.0, math.sqrt(1 - normal.y**2), -normal.y)

    def tangential(vector: Any) -> tuple[float, float]:
        given = vector.x, vector.y, vector.z
        return _dot(along_x, given), _dot(along_y, given)

    x, y = array.on_surface(centre.x, centre.y, centre.z) if array else (centre.x, centre.y)
    return ContactView(
        id=contact.id,
        state=ContactState(contact.state).name.lower(),
        x=x,
        y=y,
        force=-_dot((contact.force.x, contact.force.y, contact.force.z), (normal.x, normal.y, normal.z)),
        standard_deviation=contact.normal_force_deviation,
        area=contact.area,
        age=contact.age.sec + contact.age.nanosec * 1e-9,
        major_axis=tangential(contact.major_axis),
        minor_axis=tangential(contact.minor_axis),
        velocity=tangential(contact.velocity),
    )


def _dot(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _true_contacts(truth: TactileTruth | None) -> tuple[TrueContact, ...]:
    if truth is None:
        return ()
    touching = zip(truth.contact_centres, truth.contact_forces, strict=True)
    return tuple(TrueContact(centre.x, centre.y, force) for centre, force in touching)


def main(words: Sequence[str] | None = None) -> int:
    """Run `posfet view` and return the exit code.

    Parameters
    ----------
    words : sequence of str, optional
        Command line without the program; that of the process by default.

    Returns
    -------
    int
        0 after a clean end; 1, with one line on stderr, for bad input, or if no scan arrived in the time given.
    """
    words = sys.argv[1:] if words is None else words
    parser = argparse.ArgumentParser(
        prog="posfet view",
        description="Show the live force map of a running stack.",
        epilog="ROS arguments follow --ros-args: those that the stack was started with, such as -r __ns:=/robot.",
    )
    sensors = parser.add_mutually_exclusive_group()
    sensors.add_argument("namespaces", nargs="*", default=[], metavar="NAMESPACE", help="sensors (default: tactile)")
    sensors.add_argument("--namespace", help="namespace of the sensor")
    sensors.add_argument("--hand", metavar="FILE", help="YAML file of hand.launch.py, for its sensors")
    parser.add_argument("--for", dest="seconds", type=positive, default=math.inf, help="stop after this many seconds")
    add_web_arguments(parser)
    add_rerun_arguments(parser)

    def run() -> int:
        rest, ros_arguments = split(words)
        options = parser.parse_args(rest)
        given = options.namespaces or [options.namespace or "tactile"]
        if options.hand:
            given = [sensor["namespace"] for sensor in read_hand(options.hand)]
        namespaces = list(dict.fromkeys(ros_arguments.within(name) for name in given))
        web_port = chosen_port(options)
        rerun = options.rerun or options.rerun_file is not None
        if len(namespaces) > 1 and web_port is None and not rerun:
            raise ConfigError(f"{len(namespaces)} sensors: add --web or --rerun, since a terminal shows one")
        with ros(ros_arguments.words) as stack:
            views = []
            for namespace in namespaces:
                node = display_node(namespace, ros_arguments.words)
                stack.callback(node.destroy_node)
                client = StackClient(node, namespace)
                view = ViewNode(client, ros_arguments.words)
                stack.callback(view.destroy_node)
                views.append(view)
            viewed = [Viewed(view.client, view, Recording(view.client.namespace)) for view in views]
            link = served_link(stack, viewed, web_port)
            logged = [(view.client.namespace, view, partial(getattr, view.client, "array")) for view in views]
            stack.enter_context(rerun_view(logged, options.rerun, options.rerun_file))
            nodes = [view.client.node for view in views]

            def awaited() -> str:
                return "; ".join(filter(None, (view.awaited() for view in views)))

            with display(views[0], views[0].client, link) as screen:
                return show(screen, nodes, options.seconds, views[0].state, awaited=awaited)
        return 0

    return exit_code(run)
