# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The node of the simulated board: topics, parameters, lifecycle and shutdown."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from support.clocks import PacedClock

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH
from posfet_driver.bus.slcan_codec import LineReader, encode_line
from posfet_driver.protocol.messages import CLASSIC_BLOCK_OFFSET, COMMAND_OFFSET, FD_BLOCK_OFFSET, Command, Request
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw, TactileTruth
from posfet_msgs.srv import LoadScene
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.ros.sim_board_node import SCAN_TIMES_KEPT, SimBoardNode
from posfet_sim.scene import SceneLoads, load_scene

pytestmark = pytest.mark.ros
PATIENCE = 120.0
"""After this time [s] a test has failed."""
BACKLOG = 200
"""Scans published and not received from which on time stands still: fewer than the middleware keeps."""


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    context.try_shutdown()


@pytest.fixture
def spin(context) -> Iterator[SingleThreadedExecutor]:
    """An executor of the test; its nodes are destroyed at the end."""
    executor = SingleThreadedExecutor(context=context)
    executor.clock = PacedClock(main=False)  # of the board; the time stops while a listener is busy
    executor.boards = []
    yield executor
    for node in executor.get_nodes():
        node.destroy_node()
    executor.shutdown()


def make_board(spin, **parameters) -> SimBoardNode:
    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    node = SimBoardNode(clock=spin.clock, context=spin.context, namespace="/tactile", parameter_overrides=overrides)
    spin.boards.append(node)
    spin.add_node(node)
    return node


def state_of(spin, node: SimBoardNode) -> int:
    """Return the lifecycle state of a node, by its service."""
    future = node.create_client(GetState, "sim_board_node/get_state").call_async(GetState.Request())
    spin.spin_until_future_complete(future, PATIENCE)
    return future.result().current_state.id


class Listener(Node):
    """Collects the messages of some topics."""

    def __init__(self, spin, *topics: tuple[str, type]) -> None:
        super().__init__("listener", context=spin.context)
        self.spin = spin
        self.messages = {name: [] for name, _ in topics}
        for name, kind in topics:
            self.create_subscription(kind, f"/tactile/{name}", self.messages[name].append, 2000)
        spin.add_node(self)

    def wait(self, name: str, count: int) -> list:
        """Spin until `count` messages have arrived on a topic."""
        end = time.monotonic() + PATIENCE
        with self.spin.clock.taking_part():
            while len(self.messages[name]) < count:
                assert time.monotonic() < end, f"{len(self.messages[name])} of {count} on {name}"
                self.spin.spin_once(timeout_sec=0.02)
                if not self._behind():
                    self.spin.clock.monotonic()
        return self.messages[name]

    def _behind(self) -> bool:
        """Return whether scans are queued that should be received first."""
        newest = [each.board.index for board in self.spin.boards if (each := board.source) and board.reading]
        received = self.messages.get("raw")
        return bool(newest and received) and newest[-1] - received[-1].sequence > BACKLOG


def nanoseconds(message: TactileRaw | TactileTruth) -> int:
    """Return the stamp of a message [ns]."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_raw_carries_the_scans_of_the_board(spin) -> None:
    listener = Listener(spin, ("raw", TactileRaw))
    node = make_board(spin, seed=5, scene="press_slide_lift", frame_id="thumb", imperfections="none")
    node.start()
    messages = listener.wait("raw", 300)
    sensor = load_sensor()
    board = SimulatedBoard(sensor, SceneLoads(load_scene("press_slide_lift", sensor), sensor), 5)
    scan = Scan.empty(0, sensor.layout.taxels)
    expected = {}
    for index in range(messages[-1].sequence + 1):
        board.scan(index, scan)
        expected[index] = scan.counts.copy()
    first = messages[0]
    start = first.header.stamp.sec * 10**9 + first.header.stamp.nanosec - first.sequence * 10**6
    sequences = [message.sequence for message in messages]
    assert sequences == sorted(set(sequences))
    for message in messages:
        np.testing.assert_array_equal(message.counts, expected[message.sequence])
        assert message.header.frame_id == "thumb"
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == start + message.sequence * 10**6
        assert (message.layout_id, message.rows, message.cols, message.status, message.frames_lost) == (1, 5, 5, 0, 0)
        assert list(message.temperatures) == [25.0, 25.0]


def test_ground_truth_matches_the_scan_of_the_same_sequence(spin) -> None:
    listener = Listener(spin, ("raw", TactileRaw), ("truth", TactileTruth))
    make_board(spin, scene="two_fingers", imperfections="none").start()
    listener.wait("raw", 1)
    while not any(message.contact_forces for message in listener.messages["truth"][-1:]):
        listener.wait("truth", len(listener.messages["truth"]) + 1)
    truth = listener.messages["truth"][-1]
    while listener.messages["raw"][-1].sequence < truth.sequence:
        listener.wait("raw", len(listener.messages["raw"]) + 1)
    assert [truth.header] == [raw.header for raw in listener.messages["raw"] if raw.sequence == truth.sequence]
    sensor = load_sensor()
    board = SimulatedBoard(sensor, SceneLoads(load_scene("two_fingers", sensor), sensor), 0)
    board.scan(truth.sequence, Scan.empty(0, sensor.layout.taxels))
    expected = board.truth()
    np.testing.assert_array_equal(truth.force, expected.force.astype(np.float32))
    assert list(truth.status) == [0] * 25
    assert truth.temperature == 25.0
    assert truth.objects == ["lower", "upper"]
    assert [(pose.position.x, pose.position.y, pose.position.z) for pose in truth.poses] == [
        tuple(position) for position in expected.objects.positions.tolist()
    ]
    assert [pose.orientation.w for pose in truth.poses] == [1.0, 1.0]
    assert truth.chip_temperature == 25.0
    assert list(truth.contact_objects) == [0]
    assert [(point.x, point.y, point.z) for point in truth.contact_centres] == [(-2e-3, -2e-3, 0.0)]
    assert [(normal.x, normal.y, normal.z) for normal in truth.contact_normals] == [(0.0, 0.0, 1.0)]
    np.testing.assert_array_equal(truth.contact_forces, expected.objects.contact_forces.astype(np.float32))


def test_displays_get_the_truth_of_few_scans(spin) -> None:
    listener = Listener(spin, ("raw", TactileRaw), ("view/truth", TactileTruth))
    make_board(spin, scene="hold", imperfections="none", display_rate=50.0).start()
    shown = [
        message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in listener.wait("view/truth", 10)
    ]
    last = listener.messages["view/truth"][-1].sequence
    while listener.messages["raw"][-1].sequence < last:
        listener.wait("raw", len(listener.messages["raw"]) + 1)
    stamps = [nanoseconds(message) for message in listener.messages["raw"]]
    period = 20_000_000
    first = [new for new, old in zip(stamps[1:], stamps, strict=False) if new // period != old // period]
    assert shown[1:] == [stamp for stamp in first if shown[1] <= stamp <= shown[-1]]


def test_objects_of_a_scan_are_available_while_it_is_in_the_history(spin) -> None:
    node = make_board(spin, scene="press_slide_lift", autostart=False)
    scene = SimulatedBoard(node.sensor, SceneLoads(load_scene("press_slide_lift", node.sensor), node.sensor), 0)
    scan = Scan.empty(node.sensor.layout.id, node.sensor.layout.taxels)
    expected = {}
    for index in range(0, 2 * SCAN_TIMES_KEPT + 2, 2):
        node.source.board.scan(index, scan)
        node.deliver(scan, 0)
        expected[index] = scene.objects(node.source.board.time)
    assert node.objects_in(0) is None
    assert node.objects_in(3) is None
    for index in (1000, 2000):  # long after the board continued
        found = node.objects_in(index)
        assert found is not None
        np.testing.assert_array_equal(found.contact_centres, expected[index].contact_centres)
        assert found.contact_forces > 1.0


def test_topics_without_subscribers_are_not_computed(spin, monkeypatch) -> None:
    node = make_board(spin)
    asked = []
    monkeypatch.setattr(SimulatedBoard, "truth", lambda self: asked.append(1))
    seen = threading.Semaphore(0)
    node.sink = lambda scan: seen.release()
    node.start()
    for _ in range(50):
        assert seen.acquire(timeout=PATIENCE)
    assert not asked


def test_without_autostart_the_node_waits_for_its_transitions(spin) -> None:
    node = make_board(spin, autostart=False)
    listener = Listener(spin, ("raw", TactileRaw))
    node.start()
    assert state_of(spin, node) == State.PRIMARY_STATE_UNCONFIGURED
    node.trigger_configure()
    node.trigger_activate()
    listener.wait("raw", 10)
    board = node.source.board
    node.trigger_deactivate()
    node.trigger_cleanup()
    listener.messages["raw"].clear()
    node.trigger_configure()
    node.trigger_activate()
    listener.wait("raw", 10)
    assert node.source.board is not board


def load(spin, node: SimBoardNode, scene: str) -> LoadScene.Response:
    client = node.create_client(LoadScene, "scene/load")
    end = time.monotonic() + PATIENCE
    while not client.service_is_ready():
        assert time.monotonic() < end, "time-out"
        spin.spin_once(timeout_sec=0.02)
    future = client.call_async(LoadScene.Request(scene=scene))
    spin.spin_until_future_complete(future, PATIENCE)
    return future.result()


def test_another_scene_can_be_loaded_at_run_time(spin, tmp_path: Path) -> None:
    node = make_board(spin, scene="idle")
    node.start()
    listener = Listener(spin, ("raw", TactileRaw), ("truth", TactileTruth))
    before = listener.wait("truth", 500)[-1]
    assert before.objects == []
    response = load(spin, node, "two_fingers")
    assert (response.success, response.message) == (True, "scene 'two_fingers' from its start")
    while not (truths := [each for each in listener.messages["truth"] if each.objects]):
        listener.wait("truth", len(listener.messages["truth"]) + 1)
    assert truths[0].objects == ["lower", "upper"]
    assert truths[0].sequence < before.sequence  # the sequence restarts
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("name: wrong\n", encoding="utf-8")
    for scene, reason in (("", ": no such scene"), ("nowhere", "nowhere: no such scene"), (str(wrong), f"{wrong}: ")):
        rejected = load(spin, node, scene)
        assert not rejected.success
        assert rejected.message.startswith(reason)
    listener.messages["truth"].clear()
    assert listener.wait("truth", 10)[-1].objects == ["lower", "upper"]


def test_loading_a_scene_does_not_start_an_inactive_board(spin) -> None:
    node = make_board(spin, autostart=False)
    node.start()
    assert load(spin, node, "hold").success
    assert not node.reading
    node.trigger_configure()
    assert load(spin, node, "tap").success
    listener = Listener(spin, ("raw", TactileRaw))
    spin.spin_once(0.2)
    assert not listener.messages["raw"]
    node.trigger_activate()
    listener.wait("raw", 10)
    assert node.source.board.loads.name == "tap"


@pytest.mark.parametrize("transition", [Transition.TRANSITION_CLEANUP, Transition.TRANSITION_CONFIGURE, 99])
def test_an_invalid_transition_is_rejected_without_effect(spin, transition: int) -> None:
    node = make_board(spin)
    listener = Listener(spin, ("raw", TactileRaw))
    node.start()
    client = node.create_client(ChangeState, "sim_board_node/change_state")
    future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
    spin.spin_until_future_complete(future, PATIENCE)
    assert not future.result().success
    listener.messages["raw"].clear()
    listener.wait("raw", 10)
    assert state_of(spin, node) == State.PRIMARY_STATE_ACTIVE


@pytest.mark.parametrize("fd", [False, True])
def test_behind_an_adapter_the_board_sends_frames_and_publishes_ground_truth(spin, tmp_path: Path, fd: bool) -> None:
    link = tmp_path / "board"
    listener = Listener(spin, ("raw", TactileRaw), ("truth", TactileTruth))
    node = make_board(spin, adapter_link=str(link), can_fd=str(fd).lower(), scene="hold")
    node.start()
    sensor = load_sensor()
    with link.open("r+b", buffering=0) as terminal:
        start = (sensor.can.base_id + COMMAND_OFFSET, CLASSIC, Request(Command.START, tag=1).pack())
        terminal.write(b"O\r" + encode_line(start))
        reader, frames = LineReader(), []
        blocks = sensor.can.base_id + (FD_BLOCK_OFFSET if fd else CLASSIC_BLOCK_OFFSET)
        while len({data for identifier, _, data in frames if identifier >= blocks and len(data) > 8 * fd}) < 50:
            frames += reader.frames(terminal.read(4096))
        truth = listener.wait("truth", 20)[-1]
        assert load(spin, node, "tap").success
        assert node.source.report().values["scene"] == "tap"
        assert link.exists()
    assert {kind for identifier, kind, _ in frames if identifier == blocks} == {FD | RATE_SWITCH if fd else CLASSIC}
    assert not listener.messages["raw"]
    assert truth.objects == ["fingertip"]
    board = SimulatedBoard(sensor, SceneLoads(load_scene("hold", sensor), sensor), 0)
    board.scan(truth.sequence, Scan.empty(0, sensor.layout.taxels))
    np.testing.assert_array_equal(truth.force, board.truth().force.astype(np.float32))
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert not link.exists()


def test_an_adapter_link_failure_is_reported(spin, tmp_path: Path, capfd) -> None:
    existing = tmp_path / "file"
    existing.touch()
    node = make_board(spin, adapter_link=str(existing))
    with pytest.raises(ConfigError, match=f"{existing}: the adapter cannot be linked here: there is something else"):
        node.start()
    assert str(existing) not in capfd.readouterr().err  # reported once, by the caller of start
    node.trigger_configure()
    assert f"{existing}: the adapter cannot be linked here" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"scene": "no_such"}, "no_such: no such scene; .* posfet scene"),
        ({"scene": "/no/such.yaml"}, "/no/such.yaml: no such scene file"),
        ({"seed": -1}, r"/tactile/sim_board_node: seed: must be a whole number in \[0, .*, got -1"),
        ({"seed": 1.5}, "/tactile/sim_board_node: seed: must be a whole number .*1.5"),
        ({"scene": 3}, "/tactile/sim_board_node: scene: must be text, got 3"),
        ({"can_fd": "maybe"}, "/tactile/sim_board_node: can_fd: must be one of auto, true, false, got 'maybe'"),
        ({"sensor_file": "no_such"}, "no_such: no such sensor"),
    ],
)
def test_invalid_input_is_rejected_with_a_one_line_error(spin, parameters, reason) -> None:
    with pytest.raises(ConfigError, match=reason) as caught:
        make_board(spin, **parameters)
    assert "\n" not in str(caught.value)


def test_an_invalid_scene_file_is_rejected_at_start(spin, tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text("name: wrong\ndescription: no objects\ntemperature_degC: 25\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=f"{path}: objects: missing"):
        make_board(spin, scene=str(path))


def test_the_scene_starts_with_the_first_subscriber(spin) -> None:
    node = make_board(spin, scene="press_slide_lift")
    node.start()
    assert node.source.report().scans == 0
    assert "waiting for the first subscriber" in node.source.report().state
    first = Listener(spin, ("raw", TactileRaw)).wait("raw", 1)[0]
    assert first.sequence < 300  # the scene touches at 0.3 s: no subscriber joins in the middle of it
