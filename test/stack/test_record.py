# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recording of a live graph, also from a program as in recording.md, and the node that replays recordings."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")
pytest.importorskip("mcap", reason="recordings need the package mcap")

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

from posfet.record import WITH_INPUT, Recorder, RecorderNode, main
from posfet_model.config import ConfigError
from posfet_msgs.msg import TactileInfo, TactileRaw
from posfet_sim.commands.simulate import main as simulate
from posfet_sim.recording.mcap_file import DiskFull, MessageFile
from posfet_sim.recording.mcap_reader import Recording
from posfet_sim.ros.replay_node import ReplayNode
from support.bringup_process import bringup, needs_installation, running
from support.expectations import TIMEOUT
from support.paths import DATA

pytestmark = pytest.mark.ros
STORED = DATA / "recording" / "posfet_0.2.0.mcap"


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context)
    yield context
    context.try_shutdown()


@pytest.fixture
def executor(context: Context) -> Iterator[SingleThreadedExecutor]:
    executor = SingleThreadedExecutor(context=context)
    yield executor
    for node in executor.get_nodes():
        node.destroy_node()
    executor.shutdown()


def spin_until(executor: SingleThreadedExecutor, condition: Callable[[], bool]) -> None:
    end = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < end
        executor.spin_once(0.01)


def test_chosen_topics_are_recorded_with_their_schemas(
    tmp_path: Path, context: Context, executor: SingleThreadedExecutor
) -> None:
    path = tmp_path / "x.mcap"
    talker = rclpy.create_node("talker", context=context)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    info = talker.create_publisher(TactileInfo, "/hand/thumb/info", latched)
    raw = talker.create_publisher(TactileRaw, "/hand/thumb/raw", 10)
    other = talker.create_publisher(TactileRaw, "/hand/index/raw", 10)
    info.publish(TactileInfo(name="thumb", pitch=[1.0, 2.0]))
    file = MessageFile(path, "test")
    recorder = RecorderNode(file, ["hand/thumb"], ["info", "raw", "absent"], context=context)
    for node in (talker, recorder):
        executor.add_node(node)
    spin_until(executor, lambda: len(recorder.subscribed) == 2 and raw.get_subscription_count() == 1)
    raw.publish(TactileRaw(sequence=7, counts=[1, 2, 3]))
    other.publish(TactileRaw(sequence=8))
    spin_until(executor, lambda: file.messages == 2)
    assert recorder.missing == ["/hand/thumb/absent"]
    file.close()
    found = {each.topic.name: each.topic.reader.read(each.data) for each in Recording(path).messages()}
    assert found["/hand/thumb/info"]["name"] == "thumb"
    assert found["/hand/thumb/info"]["pitch"].tolist() == [1.0, 2.0]
    assert found["/hand/thumb/raw"]["sequence"] == 7
    assert found["/hand/thumb/raw"]["counts"].tolist() == [1, 2, 3]
    assert len(found) == 2


def test_messages_that_wait_are_written_in_the_order_of_their_arrival(
    tmp_path: Path, context: Context, executor: SingleThreadedExecutor
) -> None:
    path = tmp_path / "x.mcap"
    talker = rclpy.create_node("talker", context=context)
    publishers = [talker.create_publisher(TactileRaw, f"/thumb/{name}", 100) for name in ("first", "second")]
    file = MessageFile(path, "test")
    recorder = RecorderNode(file, ["thumb"], ["first", "second"], context=context)
    for node in (talker, recorder):
        executor.add_node(node)
    spin_until(executor, lambda: all(each.get_subscription_count() == 1 for each in publishers))
    for sequence in range(100):  # nothing is read meanwhile
        publishers[sequence % 2].publish(TactileRaw(sequence=sequence))
    spin_until(executor, lambda: file.messages == 100)
    file.close()
    found = [each.topic.reader.read(each.data)["sequence"] for each in Recording(path).messages()]
    assert found == list(range(100))


def test_the_summary_counts_the_scans_that_are_missing(
    tmp_path: Path, context: Context, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.mcap"
    talker = rclpy.create_node("talker", context=context)
    kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for name, step in (("left", 1), ("right", 3)):
        raw = talker.create_publisher(TactileRaw, f"/{name}/raw", kept)
        for sequence in range(0, 10 * step, step):
            raw.publish(TactileRaw(sequence=sequence))
    try:
        assert main([str(path), "--namespace", "left", "--topics", "raw", "--for", "0.5"]) == 0
        assert capfd.readouterr().out.rstrip().endswith("; 0 scans missing")
        path.unlink()
        assert main([str(path), "--namespace", "left", "right", "--topics", "raw", "--for", "0.5"]) == 0
    finally:
        talker.destroy_node()
    assert capfd.readouterr().out.rstrip().endswith("; 0 scans of /left/raw missing; 18 scans of /right/raw missing")


def test_a_full_disk_ends_a_recording_with_its_reason(
    tmp_path: Path, context: Context, executor: SingleThreadedExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = MessageFile(tmp_path / "x.mcap", "test")
    recorder = RecorderNode(file, ["tactile"], context=context)
    executor.add_node(recorder)

    def full(*_: object) -> None:
        raise DiskFull("x.mcap: no space")

    monkeypatch.setattr(file, "add", full)
    recorder._write(1, b"", 0)
    recorder._write(1, b"", 0)
    assert recorder.failure == "x.mcap: no space"
    file.close()


def test_the_duration_of_a_recording_counts_from_its_first_message(
    tmp_path: Path, context: Context, capfd: pytest.CaptureFixture[str]
) -> None:
    """A busy machine may take longer than that to find the topics."""
    path = tmp_path / "x.mcap"
    talker = rclpy.create_node("talker", context=context)
    ended = threading.Event()

    def publish() -> None:
        time.sleep(1.0)
        raw = talker.create_publisher(TactileRaw, "/late/raw", 10)
        while not ended.wait(0.02):
            raw.publish(TactileRaw())

    publishing = threading.Thread(target=publish)
    publishing.start()
    try:
        assert main([str(path), "--namespace", "late", "--topics", "raw", "--for", "0.5"]) == 0
    finally:
        ended.set()
        publishing.join()
        talker.destroy_node()
    assert capfd.readouterr().out.startswith(f"{path}: 0.")
    assert Recording(path).overview().counts["/late/raw"] > 1


def test_a_recording_without_a_message_ends_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("posfet.record.FIRST_MESSAGE", 0.5)
    path = tmp_path / "x.mcap"
    assert main([str(path), "--namespace", "nobody", "--for", "0.2"]) == 1
    assert capfd.readouterr().err.startswith("no message on /nobody/...: start the stack with posfet bringup")
    assert not path.exists()


def test_a_recording_is_replayed_with_its_time(context: Context, executor: SingleThreadedExecutor) -> None:
    listener = rclpy.create_node("listener", context=context)
    scans, times = [], []
    listener.create_subscription(TactileRaw, "/tactile/raw", scans.append, 100)
    listener.create_subscription(Clock, "/clock", times.append, 100)
    overrides = [Parameter("replay_file", value=str(STORED)), Parameter("replay_rate", value=0.0)]
    node = ReplayNode(context=context, namespace="/tactile", parameter_overrides=overrides)
    for each in (listener, node):
        executor.add_node(each)
    spin_until(executor, lambda: listener.count_publishers("/clock") == 1 and node.count_subscribers("/clock") == 1)
    node.start()
    spin_until(executor, lambda: len(scans) == 40 and len(times) == 4)
    assert [scan.sequence for scan in scans] == list(range(40))
    assert {scan.header.frame_id for scan in scans} == {"tactile_array"}
    assert [each.clock for each in times] == [scan.header.stamp for scan in scans[::10]]
    spin_until(executor, lambda: node.source.finished)


@pytest.mark.parametrize(
    ("path", "reason"), [("", "replay_file: is missing; name a recording"), ("none.mcap", "none.mcap: no such file")]
)
def test_a_recording_that_cannot_be_replayed_is_refused(context: Context, path: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        ReplayNode(context=context, parameter_overrides=[Parameter("replay_file", value=path)])


@pytest.mark.process
@needs_installation
def test_a_program_records_a_stack_and_the_recording_runs_through_the_model_again(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    recorder = Recorder(path, topics=["raw", "info"])
    with pytest.raises(ConfigError, match="is not being recorded"):
        recorder.stop()
    with running("source:=sim"):
        recorder.start()
        end = time.monotonic() + TIMEOUT
        while not (path.exists() and path.stat().st_size > 20_000):
            assert time.monotonic() < end
            assert recorder.running
            time.sleep(0.05)
        assert f"{path}: " in recorder.stop()
    assert not recorder.running
    counts = Recording(path).overview().counts
    assert counts["/tactile/info"] >= 1  # again when its content changes
    assert counts["/tactile/raw"] > 50
    with pytest.raises(ConfigError, match="File exists"):
        recorder.start()
    result = bringup("source:=replay", f"replay_file:={path}", "replay_rate:=0.0")
    assert result.returncode == 0, result.stderr
    assert f", {counts['/tactile/raw']} scans, " in result.stdout


@needs_installation
def test_a_live_replay_says_at_its_end_what_of_the_recording_could_not_be_read(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    assert simulate(["press", "--out", str(whole), "--for", "4"]) == 0
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    result = bringup("source:=replay", f"replay_file:={cut}", "replay_rate:=0.0")
    assert result.returncode == 0, result.stderr
    last = result.stderr.splitlines()[-1]
    assert re.fullmatch(
        rf"posfet: replay finished: {cut}: it ends within a record; \d+ messages up to .* were read", last
    )


def test_a_namespace_that_nobody_publishes_in_is_named_while_the_others_are_recorded(
    context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("posfet.record.PATIENCE", 0.2)
    talker = rclpy.create_node("talker", namespace="left", context=context)
    raw = talker.create_publisher(TactileRaw, "raw", 10)
    ended = threading.Event()

    def publish() -> None:
        while not ended.wait(0.02):
            raw.publish(TactileRaw())

    publishing = threading.Thread(target=publish)
    publishing.start()
    try:
        assert main([str(tmp_path / "x.mcap"), "--namespace", "left", "rihgt", "--for", "0.6"]) == 0
    finally:
        ended.set()
        publishing.join()
        talker.destroy_node()
    assert capfd.readouterr().err.splitlines() == [
        "/rihgt/...: nobody publishes it so far",
        "/rihgt/...: nobody published it",
    ]


def test_a_recorder_ends_with_the_input_that_the_program_holds_open(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "posfet.record", WITH_INPUT, str(tmp_path / "x.mcap"), "--for", "1000"]
    run = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT, check=False
    )
    assert run.returncode == 1
    assert run.stderr.startswith("no message on ")


def test_a_recorder_that_is_dropped_ends(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "x.mcap", ["nobody"])
    recorder._words += ["--for", "1000"]  # else it would end without a message, too
    recorder.start()
    process = recorder._process
    assert process is not None
    del recorder
    gc.collect()
    assert process.wait(TIMEOUT) is not None


def test_a_recorder_is_a_context_manager(tmp_path: Path, context: Context) -> None:
    path = tmp_path / "x.mcap"
    talker = rclpy.create_node("talker", context=context)
    raw = talker.create_publisher(
        TactileRaw, "/left/raw", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    raw.publish(TactileRaw(sequence=7))
    try:
        with Recorder(path, ["left"], ["raw"]) as recorder:
            end = time.monotonic() + TIMEOUT
            while not raw.get_subscription_count():
                assert recorder.running
                assert time.monotonic() < end
                time.sleep(0.02)
            raw.publish(TactileRaw(sequence=8))
            raw.wait_for_all_acked()
    finally:
        talker.destroy_node()
    assert not recorder.running
    assert Recording(path).overview().counts["/left/raw"] >= 1
    with pytest.raises(KeyError), Recorder(tmp_path / "y.mcap", ["nobody"]):
        raise KeyError
