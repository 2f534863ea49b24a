# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The hot path: allocations and publications of a scan, and serialisation of contacts."""

from __future__ import annotations

import gc
import sys
import time
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message

from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.contacts_message import ContactsMessage, contacts_writer
from posfet_model.ros.model_node import ModelNode
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain
from posfet_msgs.msg import TactileContacts

pytestmark = pytest.mark.ros

SENSOR = load_sensor()
DEADLINE = 120.0
REST, SCANS = 800, 600
STEADY = range(1000, 1400)
"""Scans in steady state, with a held fingertip or without touch."""
BLOCKS_A_SCAN = 0.9
"""Maximum memory blocks retained per scan, on average: caches fill once; a leak retains 1 or more per scan."""


def played(touched: bool, count: int = REST + SCANS) -> list[np.ndarray]:
    """Return counts of a board: rest, then two held fingertips if `touched`, else rest throughout."""
    chain = ForwardSignalChain(SENSOR, np.random.default_rng(3))
    force = np.zeros((5, 5))
    force[1:3, 0:2] = 0.3
    force[3:5, 3:5] = 0.2
    counts = []
    for index in range(count):
        chain.advance(force.ravel() * min(max(index - REST, 0) / 20, 1.0) * touched, 25.0, 1e-3)
        counts.append(chain.counts())
    return counts


def set_scan(scan: Scan, index: int, counts: np.ndarray) -> None:
    scan.counts[:] = counts
    scan.temperatures[:] = 25.0
    scan.sequence, scan.device_time, scan.stamp = index, index * 1000, index * 1_000_000


def test_serialised_contacts_equal_those_of_the_middleware() -> None:
    model, scan = Reconstructor(SENSOR), Scan.empty(1, 25)
    message, writer = ContactsMessage(SENSOR, "finger"), contacts_writer(SENSOR, "finger")
    assert isinstance(writer, ContactsBytes), (
        "the self-check at start failed: contacts would be serialised by the slow path"
    )
    most = 0
    for index, counts in enumerate(played(touched=True)):
        set_scan(scan, index, counts)
        result = model.process(scan)
        most = max(most, len(result.contacts))
        data = writer.fill(result)
        expected = serialize_message(message.fill(result))
        # Padding bytes are arbitrary: compare what a subscriber reads.
        assert len(data) == len(expected)
        assert str(deserialize_message(data, TactileContacts)) == str(deserialize_message(expected, TactileContacts))
    assert most == 2
    read = deserialize_message(data, TactileContacts)
    assert read.sequence == index and [contact.id for contact in read.contacts] == [1, 2]


def contacts_publisher(node: ModelNode) -> Any:
    [publisher] = [publisher for publisher in node.publishers if publisher.topic_name == "/contacts"]
    return publisher


@pytest.mark.parametrize("listening", [False, True])
def test_a_scan_publishes_only_subscribed_topics(listening: bool) -> None:
    context = Context()
    rclpy.init(context=context)
    node, peer = (
        ModelNode(context=context, parameter_overrides=[Parameter("direct", value=True)]),
        Node("peer", context=context),
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(peer)
    node.start()
    node.add_maps()
    try:
        published: dict[str, int] = {}
        for publisher in node.publishers:
            count_messages(publisher, published)
        if listening:
            peer.create_subscription(TactileContacts, "contacts", lambda _: None, 10)
            end = time.monotonic() + DEADLINE
            while contacts_publisher(node).get_subscription_count() == 0:
                assert time.monotonic() < end, "not discovered in time"
                executor.spin_once(timeout_sec=0.05)
        scan = Scan.empty(1, 25)
        for index, counts in enumerate(played(touched=True, count=100)):
            set_scan(scan, index, counts)
            node.process(scan)
        assert published == ({"contacts": 100} if listening else {})
    finally:
        executor.shutdown()
        peer.destroy_node()
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_block_maintenance_runs_after_the_contacts_are_published(monkeypatch: pytest.MonkeyPatch) -> None:
    """Block maintenance takes longer than a scan: it runs neither before a message nor in the next scan."""
    context = Context()
    rclpy.init(context=context)
    node = ModelNode(context=context, parameter_overrides=[Parameter("direct", value=True)])
    node.start()
    try:
        contacts, events, run_maintenance = contacts_publisher(node), [], Reconstructor.run_maintenance

        def maintain(reconstructor: Reconstructor) -> None:
            assert reconstructor.maintenance_due
            run_maintenance(reconstructor)
            assert not reconstructor.maintenance_due
            events.append("maintained")

        monkeypatch.setattr(Reconstructor, "run_maintenance", maintain)
        monkeypatch.setattr(SubscriptionCache, "subscribed", lambda *_: {contacts})
        contacts.publish = lambda _: events.append("published")
        scan, maintained = Scan.empty(1, 25), 0
        for index, counts in enumerate(played(touched=False, count=101)):
            set_scan(scan, index, counts)
            events.clear()
            node.process(scan)
            assert events in (["published"], ["published", "maintained"])
            maintained += len(events) - 1
        assert maintained == 5
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_subscribers_are_looked_up_one_publisher_at_a_time() -> None:
    class Counted:
        looked_up = 0

        def get_subscription_count(self) -> int:
            self.looked_up += 1
            return self.looked_up % 2

    publishers = [Counted() for _ in range(5)]
    listeners = SubscriptionCache(*publishers)
    start = 10**12
    assert listeners.subscribed(start) == set(publishers), "all publishers must be looked up before the first message"
    for now in range(start + 1_000_000, start + 1_000_000_000, 1_000_000):
        before = sum(one.looked_up for one in publishers)
        subscribed = listeners.subscribed(now)
        assert sum(one.looked_up for one in publishers) - before <= 1
        assert subscribed == {one for one in publishers if one.looked_up % 2}
    assert all(20 <= one.looked_up <= 21 for one in publishers)


def count_messages(publisher: Any, counts: dict[str, int]) -> None:
    """Count the messages of a publisher instead of sending them."""
    name = publisher.topic_name.rsplit("/", 1)[-1]

    def count(_: Any) -> None:
        counts[name] = counts.get(name, 0) + 1

    publisher.publish = count


@pytest.mark.parametrize("touched", [False, True], ids=["idle", "touched"])
def test_a_scan_retains_no_memory(touched: bool) -> None:
    """From frames to serialised contacts there are no reference cycles and no growth of memory."""
    decoder, model = Decoder(SENSOR), Reconstructor(SENSOR)
    decoder.start()
    writer, codec, scan = ContactsBytes(SENSOR, "finger"), make_codec(SENSOR), Scan.empty(1, 25)
    frames = []
    for index, counts in enumerate(played(touched)):
        set_scan(scan, index, counts)
        frames.append(codec.encode(scan, SENSOR.can.base_id))

    newest: list[Reconstruction | None] = [None]

    def take(index: int) -> None:
        for decoded in decoder.decode(frames[index], index * 1_000_000, 0):
            if isinstance(decoded, ScanReady):
                newest[0] = model.process(decoded.scan)
                writer.fill(newest[0])

    for index in range(STEADY.start):
        take(index)
    gc.collect()
    gc.disable()
    try:
        before = sys.getallocatedblocks()
        for index in STEADY:
            take(index)
        left = sys.getallocatedblocks() - before
        cycles = gc.collect()
    finally:
        gc.enable()
    assert newest[0] is not None and len(newest[0].contacts) == 2 * touched
    assert cycles == 0, "reference cycles on the hot path: the garbage collector would interrupt it"
    assert left <= BLOCKS_A_SCAN * len(STEADY), f"{left} blocks retained after {len(STEADY)} scans"
