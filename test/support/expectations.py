# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Requirements on a running stack with the simulated board and its default scene, however it was started.

Used by the launch tests and by the tests of the `bringup` executable.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2

from posfet_model.ros.run_node import NodeExecutor
from posfet_msgs.msg import TactileContact, TactileContacts, TactileImage, TactileInfo, TactileTruth

TIMEOUT = 180.0
"""Time-out for an expected message [s]; a running stack needs a fraction of it."""
ASK_PERIOD = 0.1
"""Period at which a condition is checked [s]: thousands of messages arrive in the meantime."""
REPEAT_PERIOD = 5.0
"""Time without a response after which a request is sent again [s]."""
COMPARED = 400
"""Scans with a contact that are compared with the ground truth."""
NOTHING = {"repeated", "late", "layout mismatch"}
"""Counters of the diagnostics that must exist and be 0. Scans lost between processes are not among them: a busy machine
loses some, which the model counts."""
LOST = "frames lost"
CAUSES = ("lost scans", "incomplete scans", "malformed frames", "frames not read")
"""Counters by cause, one of which counts frames that a busy machine lost between adapter and driver."""
PRESSED = 0.3
"""Minimum force of a true contact that is compared [N]."""
Pair = tuple[TactileContacts, TactileTruth, bool]


class Listener:
    """Collects the messages of a stack, in its own context."""

    def __init__(self, namespace: str = "tactile") -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=rclpy.SignalHandlerOptions.NO)
        self._node = rclpy.create_node("listener", namespace=namespace, context=self._context)
        self._executor = NodeExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._subscriptions: list = []
        self._clients: dict = {}

    def __enter__(self) -> Listener:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def collect(self, kind: type, topic: str, *, transient_local: bool = False) -> list:
        """Return a list to which every further message of `topic` is appended."""
        messages: list = []
        durability = DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE
        profile = QoSProfile(depth=1 if transient_local else 2000, durability=durability)
        self._subscriptions.append(self._node.create_subscription(kind, topic, messages.append, profile))
        return messages

    def forget(self) -> None:
        """Stop collecting, so that the next check has the whole machine."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop())

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Serve callbacks until `condition` holds, which is checked periodically; fail after TIMEOUT."""
        end = time.monotonic() + TIMEOUT
        while not condition():
            assert time.monotonic() < end, f"{what} did not arrive within {TIMEOUT:g} s"
            pause = time.monotonic() + ASK_PERIOD
            while time.monotonic() < pause:
                self._executor.spin_once(ASK_PERIOD)

    def call(self, kind: type, name: str, request: object, repeat: bool = False) -> Any:
        """Call a service and return its response.

        The middleware loses the response to a client that the service has not discovered yet. So the first request to
        a service should be one that may be sent again, with `repeat`.
        """
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        client = self._clients[name]
        self.wait(client.service_is_ready, f"service {name}")
        futures = [client.call_async(request)]
        sent = time.monotonic()

        def answered() -> bool:
            nonlocal sent
            if repeat and time.monotonic() > sent + REPEAT_PERIOD:
                futures.append(client.call_async(request))
                sent = time.monotonic()
            return any(future.done() for future in futures)

        self.wait(answered, f"response of {name}")
        return next(future for future in futures if future.done()).result()

    def published_topics(self, nodes: set[str]) -> dict[str, list[str]]:
        """Return the topics that these nodes publish, with their types."""
        topics: dict[str, list[str]] = {}
        for node in nodes:
            namespace, _, name = node.rpartition("/")
            topics.update(self._node.get_publisher_names_and_types_by_node(name, namespace))
        return topics

    def is_reliable(self, topic: str) -> bool:
        """Return whether a topic has publishers, all of which deliver to a reliable subscriber."""
        offered = [each.qos_profile.reliability for each in self._node.get_publishers_info_by_topic(topic)]
        return bool(offered) and all(each is ReliabilityPolicy.RELIABLE for each in offered)

    def node_names(self) -> set[str]:
        """Return the full names of the discovered nodes, except this one."""
        pairs = self._node.get_node_names_and_namespaces()
        return {f"{space.rstrip('/')}/{name}" for name, space in pairs if name != self._node.get_name()}


def expect_info(listener: Listener) -> None:
    """Expect the description of the sensor as transient local: a late subscriber receives it."""
    info: list[TactileInfo] = listener.collect(TactileInfo, "info", transient_local=True)
    listener.wait(lambda: bool(info), "info")
    assert (info[0].rows, info[0].cols, len(info[0].taxel_poses)) == (5, 5, 25)
    assert info[0].simulated
    assert info[0].force_unit == "N"


def expect_contacts_of_the_scene(listener: Listener) -> None:
    """Expect contacts at the scan rate of the board clock, with position and force of the scene.

    The rate of arrival depends on the load of the machine, so it is not checked. What changed in scans that a busy
    machine lost is unknown: position and force are checked as long as none was lost.
    """
    contacts: list[TactileContacts] = listener.collect(TactileContacts, "contacts")
    truths: list[TactileTruth] = listener.collect(TactileTruth, "truth")

    comparison = Comparison(contacts, truths)
    listener.wait(lambda: comparison.update() > COMPARED, "valid contacts of the scene")
    first, last = truths[0], truths[-1]
    rate = (last.sequence - first.sequence) / (_seconds(last) - _seconds(first))
    assert rate == pytest.approx(1000.0, rel=1e-4), f"{rate:.1f} scans/s"
    for found, truth in [(found, truth) for found, truth, whole in comparison.pairs if whole]:
        touching = [contact for contact in found.contacts if contact.state != TactileContact.STATE_RELEASED]
        assert touching, f"scan {found.sequence}: the scene presses, but no contact was found"
        true, pressed = truth.contact_centres[0], truth.contact_forces[0]
        nearest = min(touching, key=lambda contact: _distance(contact.centre_of_pressure, true))
        error, distance = abs(-nearest.force.z - pressed), _distance(nearest.centre_of_pressure, true)
        assert error < 0.1, f"scan {found.sequence}: force off by {error:.3f} N of {pressed:.3f} N"
        assert distance < 0.3e-3, f"scan {found.sequence}: centre of pressure off by {distance * 1e3:.3f} mm"


class Comparison:
    """Contacts beside the ground truth of their scans, and whether no scan was lost up to there.

    Each message is looked at once, so that a look costs the same however long the stack has been
    running.
    """

    def __init__(self, contacts: list[TactileContacts], truths: list[TactileTruth]) -> None:
        self._contacts, self._truths = contacts, truths
        self._contacts_seen = self._truths_seen = 0
        self._by_sequence: dict[int, TactileTruth] = {}
        self._whole, self._before = True, None
        self._begun = False
        self.pairs: list[Pair] = []
        """Valid contacts of a scan with one true contact of more than `PRESSED`, from the first rest on."""

    def update(self) -> int:
        """Take in what has arrived since the last call; return the number of pairs."""
        while self._truths_seen < len(self._truths):
            truth = self._truths[self._truths_seen]
            self._by_sequence[truth.sequence] = truth
            self._truths_seen += 1
        newest = self._truths[-1].sequence if self._truths else -1
        while self._contacts_seen < len(self._contacts) and self._contacts[self._contacts_seen].sequence <= newest:
            self._compare(self._contacts[self._contacts_seen])
            self._contacts_seen += 1
        return len(self.pairs)

    def _compare(self, found: TactileContacts) -> None:
        if self._before is not None:
            assert found.sequence > self._before, "a scan was reported twice or late"
            self._whole = self._whole and found.sequence == self._before + 1
        self._before = found.sequence
        truth = self._by_sequence.pop(found.sequence, None)
        if truth is None:
            return
        if not self._begun:  # scans that were lost in a touch before the first rest leave nothing behind
            self._begun = self._whole = not truth.contact_forces
        if self._begun and found.data_valid and _pressed(truth):
            self.pairs.append((found, truth, self._whole))


def expect_images(listener: Listener) -> None:
    """Expect image, wrench and the standard displays to agree with each other."""
    images: list[TactileImage] = listener.collect(TactileImage, "image")
    wrenches: list[WrenchStamped] = listener.collect(WrenchStamped, "wrench")
    pictures: list[Image] = listener.collect(Image, "force_image")
    clouds: list[PointCloud2] = listener.collect(PointCloud2, "points")
    listener.wait(lambda: all((images, wrenches, pictures, clouds)), "image, wrench, force_image and points")

    def pressed() -> list[tuple[TactileImage, WrenchStamped]]:
        by_stamp = {_seconds(wrench): wrench for wrench in wrenches}
        good = [image for image in images if image.data_valid and image.total_force > PRESSED]
        return [(image, by_stamp[_seconds(image)]) for image in good if _seconds(image) in by_stamp]

    listener.wait(lambda: bool(pressed()), "a pressed image and the wrench of the same scan")
    image, wrench = pressed()[-1]
    assert len(image.force) == len(image.standard_deviation) == len(image.status) == image.rows * image.cols
    assert image.total_force == pytest.approx(sum(image.force), rel=1e-4)
    assert -wrench.wrench.force.z == pytest.approx(image.total_force, rel=1e-4)
    assert (pictures[0].encoding, pictures[0].height, pictures[0].width) == ("32FC1", 5, 5)
    assert clouds[0].width * clouds[0].height == 25


def expect_no_unreported_loss(listener: Listener) -> None:
    """Expect diagnostics of every node without errors (warnings are allowed), and a cause of each loss.

    While a busy machine lets the board or the driver stand still, the driver truly reports that no scans arrive: what
    is expected is a moment without errors.
    """
    arrays: list[DiagnosticArray] = listener.collect(DiagnosticArray, "/diagnostics")

    def newest() -> dict[str, object]:
        return {status.name: status for array in arrays for status in array.status}

    def reporting() -> set[str]:
        return {value.key for status in newest().values() for value in status.values}

    listener.wait(lambda: reporting() >= {*NOTHING, LOST}, f"diagnostics with {', '.join(sorted({*NOTHING, LOST}))}")
    seen = len(arrays)
    listener.wait(lambda: len(arrays) > seen + 2, "a second round of diagnostics")
    good = {DiagnosticStatus.OK, DiagnosticStatus.WARN}
    listener.wait(lambda: all(status.level in good for status in newest().values()), "diagnostics without errors")
    for status in newest().values():
        for value in status.values:
            if value.key in NOTHING:
                assert value.value == "0", f"{status.name}: {value.key} = {value.value}"
        counted = {value.key: value.value for value in status.values}
        if counted.get(LOST, "0") != "0":
            assert any(counted.get(cause, "0") != "0" for cause in CAUSES), f"{status.name}: {counted}"


def expect_stack(listener: Listener) -> None:
    """Expect all of the above."""
    for expectation in (expect_info, expect_contacts_of_the_scene, expect_images, expect_no_unreported_loss):
        expectation(listener)
        listener.forget()


def _pressed(truth: TactileTruth) -> bool:
    return len(truth.contact_forces) == 1 and truth.contact_forces[0] > PRESSED


def _seconds(message: object) -> float:
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec * 1e-9


def _distance(found: object, true: object) -> float:
    return math.hypot(found.x - true.x, found.y - true.y)
