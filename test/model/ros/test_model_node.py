# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The model node in process: scans of the forward chain are published on raw, its outputs received by a subscriber."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from posfet_model.calibration.calibration_folder import CalibrationFolder
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstructor, TaxelStatus
from posfet_model.ros import model_diagnostics, model_node, model_report
from posfet_model.ros.model_node import ModelNode
from posfet_model.ros.scan_reader import ScanReader
from posfet_model.sensor.description import SENSOR_FOLDER, load_sensor
from posfet_model.sensor.scan import ScanStatus
from posfet_model.sensor.signal_chain import ForwardSignalChain
from posfet_msgs.msg import TactileContact, TactileContacts, TactileImage, TactileInfo, TactileRaw, TactileVibration
from posfet_msgs.srv import CalibrationFile
from posfet_msgs.srv import Tare as TareService
from reference.dense_pressure import sphere_forces
from support.long_cases import long_cases

pytestmark = pytest.mark.ros

SENSOR = load_sensor()
DEADLINE = 120.0
PRESS_FROM, PRESS_UNTIL, SCANS = 300, 400, 450
X, Y, FORCE = 0.6e-3, -0.4e-3, 1.5


class Bench:
    """A node under test and a subscriber, spun in this thread until an event occurs."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.peer = self.add(Node("peer", context=self.context))

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        return node

    def model(self, **parameters: Any) -> ModelNode:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = self.add(ModelNode(context=self.context, parameter_overrides=overrides))
        try:
            node.start()
        except ConfigError:  # its services must not answer in place of those of another
            self.executor.remove_node(node)
            node.destroy_node()
            raise
        if node.parameters["direct"]:
            node.add_maps()
        return node

    def listen(self, kind: Any, topic: str, qos: Any = 1000) -> list[Any]:
        received: list[Any] = []
        self.peer.create_subscription(kind, topic, received.append, qos)
        return received

    def wait_for_subscribers(self, node: ModelNode, *topics: str) -> None:
        """Spin until the node sees a subscriber to each of its topics."""

        def subscribed() -> int:
            names = (each.topic_name.removeprefix("/") for each in node.publishers if each.get_subscription_count())
            return sum(name in topics for name in names)

        self.spin_until(lambda: subscribed() == len(topics))

    def spin_until(self, done: Callable[[], bool]) -> None:
        end = time.monotonic() + DEADLINE
        while not done():
            assert time.monotonic() < end, "time-out"
            self.executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        for node in self.executor.get_nodes():
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def recorded_scans() -> list[TactileRaw]:
    """Return scans of a sphere that presses from scan 300 to 399, at 1 kHz."""
    layout = SENSOR.layout
    chain = ForwardSignalChain(SENSOR, np.random.default_rng(3))
    pressed = sphere_forces(X, Y, FORCE, 6e-3, 1e6, SENSOR.device.contact_spread, layout.pitch_x, layout.rows)
    messages = []
    for index in range(SCANS):
        chain.advance(pressed if PRESS_FROM <= index < PRESS_UNTIL else np.zeros(layout.taxels), 25.0, 1e-3)
        message = TactileRaw(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        message.header.stamp.sec, message.header.stamp.nanosec = 1_700_000_000, index * 1_000_000
        message.sequence, message.device_time = index, index * 1000
        message.counts = chain.counts().tolist()
        message.temperatures = [25.0, 25.0]
        messages.append(message)
    return messages


def process(node: ModelNode, scans: Sequence[TactileRaw]) -> None:
    """Have the node process the scans without transport."""
    reader = ScanReader(SENSOR.layout)
    for message in scans:
        node.process(reader.read(message))


def play(bench: Bench, outputs: tuple[list[Any], ...], scans: list[TactileRaw]) -> None:
    """Publish the scans one by one and wait for all outputs of each before the next."""
    raw = bench.peer.create_publisher(TactileRaw, "raw", 100)
    bench.spin_until(lambda: raw.get_subscription_count() > 0)
    for message in scans:
        before = [len(received) for received in outputs]
        raw.publish(message)
        bench.spin_until(lambda before=before: all(len(r) > n for r, n in zip(outputs, before, strict=True)))


def test_a_press_is_published_as_one_contact_with_all_its_messages(bench: Bench) -> None:
    outputs = tuple(
        bench.listen(kind, topic)
        for kind, topic in (
            (TactileContacts, "contacts"),
            (TactileImage, "image"),
            (WrenchStamped, "wrench"),
            (Image, "force_image"),
            (PointCloud2, "points"),
        )
    )
    contacts, images, wrenches, pictures, clouds = outputs
    node = bench.model()
    bench.wait_for_subscribers(node, "contacts", "image", "wrench", "force_image", "points")
    play(bench, outputs, recorded_scans())

    assert not contacts[0].data_valid
    assert contacts[-1].data_valid
    assert not contacts[-1].contacts
    [contact] = contacts[350].contacts
    assert contact.state == TactileContact.STATE_HELD
    assert math.dist((contact.centre_of_pressure.x, contact.centre_of_pressure.y), (X, Y)) < 0.1e-3
    assert contact.force.z == pytest.approx(-FORCE, abs=0.03)
    assert contact.normal.z == 1.0
    assert 1e-3 < contact.force_covariance[8] ** 0.5 < 0.1 * FORCE, "gains, and what an uncalibrated film may do"
    assert not any(contact.force_covariance[:8]), "of the normal force alone, like the force"
    assert contact.age.nanosec == 50_000_000
    assert list(contact.taxels) == sorted(contact.taxels)
    states = [c.state for message in contacts for c in message.contacts if c.id == contact.id]
    assert states[0] == TactileContact.STATE_NEW
    assert states.count(TactileContact.STATE_RELEASED) == 1
    [released] = contacts[PRESS_UNTIL].contacts
    assert (released.state, released.force.z) == (TactileContact.STATE_RELEASED, 0.0)

    image, wrench = images[350], wrenches[350].wrench
    assert image.header.stamp.nanosec == 350_000_000
    assert image.total_force == pytest.approx(FORCE, abs=0.03)
    assert image.total_force == pytest.approx(sum(image.force), abs=1e-5)
    assert list(image.status) == [TactileImage.TAXEL_OK] * SENSOR.layout.taxels
    assert wrench.force.z == pytest.approx(-image.total_force, abs=1e-6)
    # A force (0, 0, -f) at (x, y) has the moment (-y*f, x*f, 0) about the origin.
    assert wrench.torque.x == pytest.approx(-Y * FORCE, abs=3e-5)
    assert wrench.torque.y == pytest.approx(X * FORCE, abs=3e-5)
    picture = np.frombuffer(pictures[350].data, np.float32).reshape(pictures[350].height, pictures[350].width)
    np.testing.assert_array_equal(picture.reshape(-1), np.asarray(image.force))
    points = np.frombuffer(clouds[350].data, np.float32).reshape(-1, 4)
    np.testing.assert_array_equal(points[:, 3], np.asarray(image.force))
    np.testing.assert_allclose(points[:, :2], SENSOR.layout.positions, rtol=0, atol=1e-9)
    assert np.isnan(np.asarray(images[0].force)).all()
    assert not clouds[0].is_dense


def test_on_a_bent_chip_all_positions_lie_on_its_surface(bench: Bench, tmp_path: Any) -> None:
    path, radius = tmp_path / "bent.yaml", 6e-3
    text = (SENSOR_FOLDER / "posfet_5x5.yaml").read_text(encoding="utf-8")
    path.write_text(text.replace("  # bend_axis", "  bend_radius_mm: 6.0\n  bend_axis: y\n  # bend_axis"))
    transient_local = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    outputs = tuple(
        bench.listen(kind, topic)
        for kind, topic in ((TactileContacts, "contacts"), (WrenchStamped, "wrench"), (PointCloud2, "points"))
    )
    infos = bench.listen(TactileInfo, "info", transient_local)
    node = bench.model(sensor_file=str(path))
    bench.wait_for_subscribers(node, "contacts", "wrench", "points")
    play(bench, outputs, recorded_scans()[:360])
    bench.spin_until(lambda: len(infos) > 0)
    contacts, wrenches, clouds = outputs
    [contact] = contacts[350].contacts
    normal = np.array([contact.normal.x, contact.normal.y, contact.normal.z])
    force = np.array([contact.force.x, contact.force.y, contact.force.z])
    centre = np.array([contact.centre_of_pressure.x, contact.centre_of_pressure.y, contact.centre_of_pressure.z])
    np.testing.assert_allclose(normal, [math.sin(X / radius), 0.0, math.cos(X / radius)], rtol=0, atol=0.02)
    np.testing.assert_allclose(force, -np.linalg.norm(force) * normal, rtol=0, atol=1e-9)
    assert np.linalg.norm(force) == pytest.approx(FORCE, abs=0.03)
    # On the cylinder about an axis along y, one radius below the centre of the array.
    assert math.hypot(centre[0], centre[2] + radius) == pytest.approx(radius, abs=1e-9)
    np.testing.assert_allclose(
        np.reshape(contact.force_covariance, (3, 3)),
        contact.normal_force_deviation**2 * np.outer(normal, normal),
        rtol=1e-6,
        atol=0,
    )
    assert 1e-3 < contact.normal_force_deviation < 0.1 * FORCE, "gains, and what an uncalibrated film may do"
    points = np.frombuffer(clouds[350].data, np.float32).reshape(-1, 4)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 2] + radius), radius, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        points[:, :3], [(p.position.x, p.position.y, p.position.z) for p in infos[0].taxel_poses], atol=1e-8
    )
    wrench = wrenches[350].wrench
    assert math.hypot(wrench.force.x, wrench.force.z) < FORCE
    assert wrench.force.x < 0.0
    # A force through the axis of the cylinder has no moment about it.
    assert wrench.torque.y == pytest.approx(-radius * wrench.force.x, abs=1e-9)


def test_markers_appear_and_disappear_with_the_contact(bench: Bench) -> None:
    markers = bench.listen(MarkerArray, "markers")
    node = bench.model(direct=True, display_rate=2000.0)  # a message for every scan
    bench.wait_for_subscribers(node, "markers")
    scans = recorded_scans()
    process(node, scans)
    bench.spin_until(lambda: len(markers) == len(scans))
    shown = [(m.action, m.ns) for message in markers for m in message.markers]
    assert (Marker.ADD, "contact") in shown
    assert (Marker.ADD, "force") in shown
    gone = markers[PRESS_UNTIL].markers
    assert [(m.action, m.ns) for m in gone] == [(Marker.DELETE, "contact"), (Marker.DELETE, "force")]
    assert {m.id for m in gone} == {m.id for m in markers[PRESS_UNTIL - 1].markers}
    assert not markers[-1].markers


def test_displays_get_the_same_few_scans_on_every_topic(bench: Bench) -> None:
    kinds = {"contacts": TactileContacts, "image": TactileImage}
    full = {topic: bench.listen(kind, topic) for topic, kind in kinds.items()}
    shown = {topic: bench.listen(kind, f"view/{topic}") for topic, kind in kinds.items()}
    node = bench.model(display_rate=50.0)
    bench.wait_for_subscribers(node, *full, *(f"view/{topic}" for topic in shown))
    scans = recorded_scans()
    play(bench, tuple(full.values()), scans)
    expected = [message.sequence for message in scans if message.sequence % 20 == 0]
    bench.spin_until(lambda: all(len(messages) == len(expected) for messages in shown.values()))
    for topic, messages in shown.items():
        assert [message.sequence for message in messages] == expected
        # As text: NaN is not equal to itself, and the padding of serialized messages is any bytes.
        same = {message.sequence: repr(message) for message in full[topic]}
        assert [repr(message) for message in messages] == [same[number] for number in expected]


def test_what_is_for_displays_is_computed_for_their_scans_only(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.listen(TactileImage, "view/image")
    node = bench.model(direct=True, display_rate=50.0)
    bench.wait_for_subscribers(node, "view/image")
    images: list[int] = []
    image = Reconstructor.image
    monkeypatch.setattr(Reconstructor, "image", lambda self: images.append(1) or image(self))
    scans = recorded_scans()
    process(node, scans)
    assert len(images) == len([message for message in scans if message.sequence % 20 == 0])


@pytest.mark.parametrize(("reliability", "expected"), [("reliable", "RELIABLE"), ("best_effort", "BEST_EFFORT")])
def test_topics_have_the_reliability_of_the_parameter(bench: Bench, reliability: str, expected: str) -> None:
    node = bench.model(reliability=reliability)
    scans = [each for each in node.subscriptions if each.topic_name.endswith("raw")]
    ours = {
        each.topic_name.removeprefix("/"): each.qos_profile.reliability.name
        for each in [*node.publishers, *scans]
        if each.topic_name.count("/") == 1 or "/view/" in each.topic_name
    }
    assert ours.pop("info") == "RELIABLE"
    shared = {"diagnostics", "rosout", "parameter_events", "tf_static"}
    assert {name: kind for name, kind in ours.items() if name not in shared} == dict.fromkeys(
        ["contacts", "image", "wrench", "wrench_estimate", "force_image", "points", "markers", "vibration",
         "view/contacts", "view/image", "raw"], expected,
    )  # fmt: skip


def test_best_effort_reaches_who_asks_for_it(bench: Bench) -> None:
    contacts = bench.listen(
        TactileContacts, "contacts", QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    node = bench.model(reliability="best_effort")
    bench.wait_for_subscribers(node, "contacts")
    raw = bench.peer.create_publisher(TactileRaw, "raw", 100)  # reliable: the node takes it, too
    bench.spin_until(lambda: raw.get_subscription_count() > 0)
    scans = iter(recorded_scans() * 10)
    while not contacts:  # whatever was lost
        raw.publish(next(scans))
        bench.executor.spin_once(timeout_sec=0.05)


def test_nothing_is_published_without_subscribers(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    node = bench.model(direct=True)
    published: list[str] = []
    for publisher in node.publishers:
        monkeypatch.setattr(publisher, "publish", lambda message, name=publisher.topic_name: published.append(name))
    process(node, recorded_scans())
    assert not published
    snapshot = node.latest()
    assert snapshot is not None
    assert (snapshot.scans, snapshot.missed, snapshot.valid) == (SCANS, 0, True)
    assert snapshot.force.shape == (SENSOR.layout.rows, SENSOR.layout.cols)


def test_latest_is_a_copy_and_none_before_the_first_scan(bench: Bench) -> None:
    node = bench.model(direct=True)
    assert node.latest() is None
    scans = recorded_scans()
    process(node, scans[:350])
    pressed = node.latest()
    assert pressed is not None
    total, force = pressed.total, pressed.force.copy()
    assert total == pytest.approx(FORCE, abs=0.03)
    process(node, scans[350:])
    np.testing.assert_array_equal(pressed.force, force)
    assert node.latest().total == pytest.approx(0.0, abs=0.03)


def test_info_is_transient_local_and_describes_the_sensor(bench: Bench) -> None:
    node = bench.model(simulated=True, direct=True)
    node.use_frame("thumb")
    infos = bench.listen(TactileInfo, "info", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    bench.spin_until(lambda: bool(infos))
    [info] = infos
    layout = node.sensor.layout
    assert (info.layout_id, info.rows, info.cols, info.name) == (layout.id, layout.rows, layout.cols, node.sensor.name)
    assert info.simulated
    assert info.header.frame_id == "thumb"
    assert info.force_max > node.sensor.device.force_max
    assert info.force_min < 0
    # One step of 16 bits over 10 V, over 38 pC/N on 42.5 uF/m2 and 1 mm2 with a gain of 0.9924.
    assert info.force_resolution == pytest.approx(10 / 65535 / (38e-6 / 4.25e-5 * 0.992385), rel=1e-3)
    where = [(pose.position.x, pose.position.y) for pose in info.taxel_poses]
    np.testing.assert_allclose(where, layout.positions, rtol=0, atol=1e-12)


def mismatches(diagnostics: DiagnosticArray) -> str:
    """Return the counter of layout mismatches in a diagnostics message of the node."""
    return {entry.key: entry.value for entry in diagnostics.status[0].values}["layout mismatch"]


def test_scans_of_another_layout_are_counted_and_reported_in_diagnostics(bench: Bench) -> None:
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.model(direct=True)
    bench.wait_for_subscribers(node, "diagnostics")
    good = recorded_scans()[0]
    for change in ({"layout_id": 9}, {"rows": 1, "cols": 25}, {"counts": [1, 2, 3]}, {"counts": []}):
        message = TactileRaw(layout_id=good.layout_id, rows=good.rows, cols=good.cols)
        message.counts, message.temperatures = good.counts, good.temperatures
        for name, value in change.items():
            setattr(message, name, value)
        process(node, [message])
    reported_before = len(diagnostics)
    bench.spin_until(lambda: len(diagnostics) > reported_before and mismatches(diagnostics[-1]) != "0")
    status = diagnostics[-1].status[0]
    assert mismatches(diagnostics[-1]) == "4"
    assert status.level == b"\x02"
    assert "layout mismatch" in status.message
    assert node.latest() is None


def with_fields(message: TactileRaw, change: dict[str, Any]) -> TactileRaw:
    """Return a copy of a scan with changed fields."""
    copy = TactileRaw(layout_id=message.layout_id, rows=message.rows, cols=message.cols)
    copy.header, copy.sequence, copy.device_time = message.header, message.sequence, message.device_time
    copy.counts, copy.temperatures = message.counts, message.temperatures
    for name, value in change.items():
        setattr(copy, name, value)
    return copy


ALTERNATING = [0, 0xFFFF] * 12 + [0]


@pytest.mark.parametrize(
    "change",
    long_cases(
        [
            {"counts": [0xFFFF] * 25},
            {"counts": ALTERNATING},
            {"counts": [1, 2, 3]},
            {"rows": 1, "cols": 25},
            {"layout_id": 9},
            {"status": int(ScanStatus.ADC_FAULT)},
        ],
        [{"counts": ALTERNATING}, {"rows": 1, "cols": 25}],
    ),
)
def test_an_unusable_scan_gives_invalid_frames_and_the_next_ones_are_valid(
    bench: Bench, change: dict[str, Any]
) -> None:
    outputs = (bench.listen(TactileContacts, "contacts"), bench.listen(TactileImage, "image"))
    node = bench.model()
    bench.wait_for_subscribers(node, "contacts", "image")
    scans = recorded_scans()
    scans[350] = with_fields(scans[350], change)
    play(bench, outputs, scans[:360])
    contacts, images = outputs
    for message in (contacts[350], images[350]):
        assert (message.sequence, message.header.stamp.nanosec) == (350, 350_000_000)
        assert not message.data_valid
    assert [contact.id for contact in contacts[350].contacts] == [contact.id for contact in contacts[349].contacts]
    assert np.isnan(images[350].force).all()
    assert math.isnan(images[350].total_force)
    for message in contacts[351:]:
        assert message.data_valid
        [contact] = message.contacts
        assert contact.id == contacts[349].contacts[0].id
        assert contact.force.z == pytest.approx(-FORCE, abs=0.03)
    assert images[351].total_force == pytest.approx(FORCE, abs=0.03)


@pytest.mark.parametrize("again", [350, 340])
def test_a_duplicate_or_late_scan_gives_no_frame(bench: Bench, again: int) -> None:
    received = bench.listen(TactileContacts, "contacts")
    node = bench.model(direct=True)
    bench.wait_for_subscribers(node, "contacts")
    scans = recorded_scans()
    process(node, [*scans[:351], scans[again], *scans[351:355]])
    bench.spin_until(lambda: len(received) == 355)
    assert [message.sequence for message in received] == list(range(355))
    assert all(message.data_valid for message in received[340:])


def test_vibration_is_published_for_subscribers(bench: Bench) -> None:
    received = bench.listen(TactileVibration, "vibration")
    node = bench.model()
    bench.wait_for_subscribers(node, "vibration")
    play(bench, (received,), recorded_scans()[:320])
    assert (received[0].rows, received[0].cols, received[0].band_low) == (5, 5, 50.0)
    assert received[299].data_valid
    # The press is a step of 1.5 N between two scans, with the largest vibration at its position.
    quiet, pressed = np.array(received[299].vibration), np.array(received[305].vibration)
    assert 0 < quiet.max() < 2e-3
    assert pressed.argmax() == 12
    assert pressed.max() > 20 * quiet.max()


def test_an_invalid_parameter_or_file_is_reported_in_one_line(bench: Bench) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: no such sensor file"):
        bench.model(sensor_file="nowhere.yaml")
    with pytest.raises(ConfigError, match="direct: must be true or false"):
        bench.model(direct=3)
    with pytest.raises(
        ConfigError, match=r"release_threshold: must be at most contact_threshold, 0\.01 N, got 0\.02 N"
    ):
        bench.model(contact_threshold=0.01, release_threshold=0.02)


def constants(message: Any, prefix: str) -> dict[str, int]:
    names = [name for name in dir(message) if name.startswith(prefix)]
    return {name.removeprefix(prefix): getattr(message, name) for name in names}


@pytest.mark.parametrize(
    ("message", "prefix", "enumeration"),
    [
        (TactileRaw, "STATUS_", ScanStatus),
        (TactileImage, "TAXEL_", TaxelStatus),
        (TactileContact, "STATE_", ContactState),
    ],
)
def test_message_constants_equal_those_of_the_code(message: Any, prefix: str, enumeration: Any) -> None:
    assert constants(message, prefix) == {name: int(member) for name, member in enumeration.__members__.items()}


def call(bench: Bench, kind: Any, name: str, **fields: Any) -> Any:
    client = bench.peer.create_client(kind, name)
    bench.spin_until(client.service_is_ready)
    future = client.call_async(kind.Request(**fields))
    bench.spin_until(future.done)
    return future.result()


def test_tare_is_rejected_under_load_and_reports_the_change_at_rest(bench: Bench) -> None:
    model = bench.model()
    assert not call(bench, TareService, "tare").success
    feed = recorded_scans()
    process(model, feed[:PRESS_FROM])
    answer = call(bench, TareService, "tare")
    assert answer.success, answer.message
    assert len(answer.force_change) == SENSOR.layout.taxels
    assert 0 < max(abs(change) for change in answer.force_change) < 1e-3
    process(model, feed[PRESS_FROM : PRESS_UNTIL - 10])
    answer = call(bench, TareService, "tare")
    assert not answer.success
    assert "under load" in answer.message
    assert len(answer.force_change) == 0
    assert model.latest().total == pytest.approx(FORCE, abs=0.05)


def test_a_forced_tare_is_done_under_load(bench: Bench) -> None:
    model = bench.model()
    feed = recorded_scans()
    process(model, feed[: PRESS_UNTIL - 50])
    answer = call(bench, TareService, "tare", force=True)
    assert answer.success, answer.message
    assert sum(answer.force_change) == pytest.approx(-FORCE, abs=0.05)
    process(model, feed[PRESS_UNTIL - 50 : PRESS_UNTIL - 10])
    assert model.latest().total == pytest.approx(0.0, abs=0.05)
    assert not model.latest().contacts


def test_another_calibration_gives_no_contact_an_id_that_was_given_before(bench: Bench, tmp_path: Any) -> None:
    model, ids = bench.model(calibration_folder=str(tmp_path)), []
    assert call(bench, CalibrationFile, "calibration/save", path="cal.yaml").success
    for _ in range(2):
        process(model, recorded_scans()[: PRESS_UNTIL - 10])
        [contact] = model.latest().contacts
        ids.append(contact.id)
        assert call(bench, CalibrationFile, "calibration/load", path="cal.yaml").success
    assert ids == [1, 2]


def test_calibrations_are_saved_loaded_and_rejected_in_one_line(bench: Bench, tmp_path: Any) -> None:
    model, path = bench.model(calibration_folder=str(tmp_path)), tmp_path / "cal.yaml"
    answer = call(bench, CalibrationFile, "calibration/save", path="cal.yaml")
    assert (answer.success, answer.message) == (True, f"{path}: written")
    answer = call(bench, CalibrationFile, "calibration/load", path="cal.yaml")
    assert answer.success, answer.message
    process(model, recorded_scans()[: PRESS_UNTIL - 10])
    assert model.latest().total == pytest.approx(FORCE, abs=0.05)
    path.write_text(path.read_text().replace("layout: 1", "layout: 2"))
    answer = call(bench, CalibrationFile, "calibration/load", path="cal.yaml")
    assert not answer.success
    assert "another layout" in answer.message
    with pytest.raises(ConfigError, match="another layout"):
        bench.model(calibration_file=str(path))
    for action, bad, reason in (
        ("save", "no/cal.yaml", "cannot be written"),
        ("save", "cal.yaml", "exists and is no calibration of this sensor"),
        ("load", "none.yaml", "cannot be read"),
        *((action, bad, "must be the name of a file in") for action in ("load", "save") for bad in ("", "/dev/null")),
        *((action, f"{'x' * 250}.yaml", "must be the name of a file in") for action in ("load", "save")),
    ):
        answer = call(bench, CalibrationFile, f"calibration/{action}", path=bad)
        assert not answer.success
        assert answer.message.count(reason) == 1


def test_a_calibration_folder_that_cannot_be_written_is_reported_at_the_start_and_read(
    bench: Bench, tmp_path: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(model_diagnostics, "REPORT_PERIOD", 0.01)
    sensor = load_sensor("posfet_5x5")
    CalibrationFolder(str(tmp_path), sensor).save("cal.yaml", Calibration.nominal(sensor))
    monkeypatch.setattr("os.access", lambda path, mode: False)  # as for a user without permission
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    bench.model(calibration_folder=str(tmp_path))
    problem = f"{tmp_path}: the calibration folder cannot be written: {tmp_path} is not writable"
    bench.spin_until(lambda: bool(diagnostics))
    assert capfd.readouterr().err.count(f"{problem}: calibration/save will be refused\n") == 1
    assert {each.key: each.value for each in diagnostics[-1].status[0].values}["calibration folder"] == problem
    answer = call(bench, CalibrationFile, "calibration/save", path="cal.yaml")
    assert (answer.success, answer.message) == (False, problem)
    assert call(bench, CalibrationFile, "calibration/load", path="cal.yaml").success


@pytest.mark.parametrize("begins", [1, 100])
def test_a_contact_that_begins_while_another_calibration_is_prepared_keeps_its_id(
    bench: Bench, tmp_path: Any, monkeypatch: pytest.MonkeyPatch, begins: int
) -> None:
    model, given, prepared = bench.model(calibration_folder=str(tmp_path)), [], []
    assert call(bench, CalibrationFile, "calibration/save", path="cal.yaml").success
    process(model, recorded_scans()[:PRESS_FROM])

    def prepare(*arguments: Any) -> Reconstructor:
        prepared.append(1)
        made = Reconstructor(*arguments)
        if len(prepared) <= min(begins, model_node.ATTEMPTS):  # scans go on meanwhile
            feed = recorded_scans()
            process(
                model, [*feed[PRESS_FROM : PRESS_UNTIL + 1], *feed[:PRESS_FROM]] if prepared[1:] else feed[PRESS_FROM:]
            )
            given.append(model._reconstructor.next_id - 1)
        return made

    monkeypatch.setattr(model_node, "Reconstructor", prepare)
    assert call(bench, CalibrationFile, "calibration/load", path="cal.yaml").success
    assert len(prepared) == min(begins, model_node.ATTEMPTS) + 1
    process(model, recorded_scans()[: PRESS_UNTIL - 10])
    [contact] = model.latest().contacts
    assert contact.id == max(given) + 1 > 1


def test_a_second_publisher_of_contacts_or_scans_is_reported(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_diagnostics, "REPORT_PERIOD", 0.01)
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    bench.model(direct=False)
    bench.spin_until(lambda: bool(diagnostics))
    assert "another node" not in diagnostics[-1].status[0].message
    publishers = [bench.peer.create_publisher(TactileRaw, "raw", 1) for _ in range(2)]
    bench.spin_until(lambda: "another node publishes /raw, too" in diagnostics[-1].status[0].message)
    publishers.append(bench.peer.create_publisher(TactileContacts, "contacts", 1))
    both = "another node publishes /raw and /contacts, too"
    bench.spin_until(lambda: both in diagnostics[-1].status[0].message)
    for publisher in publishers:
        bench.peer.destroy_publisher(publisher)
    bench.spin_until(lambda: "another node" not in diagnostics[-1].status[0].message)


def test_the_limit_of_uncertainty_is_the_parameter_also_with_a_loaded_calibration(bench: Bench, tmp_path: Any) -> None:
    model = bench.model(max_relative_uncertainty=1e-3, calibration_folder=str(tmp_path))
    for _ in range(2):
        # No force is as certain as that.
        process(model, recorded_scans()[: PRESS_UNTIL - 10])
        assert model.latest().total == pytest.approx(FORCE, abs=0.1)
        assert not model.latest().valid
        assert call(bench, CalibrationFile, "calibration/save", path="cal.yaml").success
        assert call(bench, CalibrationFile, "calibration/load", path="cal.yaml").success
    certain = bench.model(max_relative_uncertainty=1.0)
    process(certain, recorded_scans()[: PRESS_UNTIL - 10])
    assert certain.latest().valid


@pytest.mark.parametrize("limit", [0.0, float("nan")])
def test_a_meaningless_limit_of_uncertainty_is_rejected(bench: Bench, limit: float) -> None:
    with pytest.raises(ConfigError, match="must be a number"):
        bench.model(max_relative_uncertainty=limit)


ALIAS_BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (ALIAS_BOMB, "anchors and aliases"),
        ("version: 1" + ":1" * 3000, "a number of more than 100 characters"),
        ("[" * 30_000, "nested more than"),
        ("version: " + "1" * 5000, "a number of more than 100 characters"),
        ("version: !!int ''", "tags"),
        (" " * 2_000_000, "larger than 70 kB"),
        (None, "not a regular file"),
    ],
)
def test_no_calibration_file_ends_the_node(bench: Bench, tmp_path: Any, content: str | None, reason: str) -> None:
    model = bench.model(calibration_folder=str(tmp_path))
    if content is None:
        os.mkfifo(tmp_path / "cal.yaml")
    else:
        (tmp_path / "cal.yaml").write_text(content)
    answer = call(bench, CalibrationFile, "calibration/load", path="cal.yaml")
    assert not answer.success
    assert reason in answer.message
    assert len(answer.message) < 300
    process(model, recorded_scans()[:2])
    assert model.latest().scans == 2


@pytest.mark.parametrize("service", ["tare", "calibration/load", "calibration/save"])
def test_a_failing_service_answers_and_scans_go_on(
    bench: Bench, tmp_path: Any, monkeypatch: pytest.MonkeyPatch, service: str
) -> None:
    model = bench.model(calibration_folder=str(tmp_path))

    def fail(*_: Any) -> None:
        raise OSError(5, "two\nlines")

    monkeypatch.setattr(model._reconstructor, "tare", fail)
    monkeypatch.setattr(CalibrationFolder, "load", fail)
    monkeypatch.setattr(CalibrationFolder, "save", fail)
    answer = call(bench, TareService if service == "tare" else CalibrationFile, service)
    assert not answer.success
    assert answer.message == "internal error, see the log of the node: OSError: [Errno 5] two lines"
    process(model, recorded_scans()[:2])
    assert model.latest().scans == 2


def test_a_failing_report_is_logged_once_and_the_node_goes_on(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(model_diagnostics, "REPORT_PERIOD", 0.01)
    calls = []

    def fail(*_: Any) -> None:
        calls.append(1)
        raise ValueError("no verdict")

    monkeypatch.setattr(model_report, "judge", fail)
    model = bench.model()
    bench.spin_until(lambda: len(calls) >= 3)
    process(model, recorded_scans()[:2])
    assert model.latest().scans == 2
    assert capfd.readouterr().err.count("ValueError: no verdict") == 1
