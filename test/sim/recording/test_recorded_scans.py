# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of recordings, of other versions, too, and the recording as a source of scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mcap", reason="recordings need the package mcap")

from posfet_driver.board.faults import Health
from posfet_model.config import ConfigError
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.recorded_scans import INFO, RAW, RecordedScans
from posfet_sim.recording.replay_source import LONGEST_PAUSE, ReplaySource
from support.clocks import SteppedClock
from support.paths import DATA

STORED = DATA / "recording" / "posfet_0.2.0.mcap"
"""40 scans of the simulated board at 1 kHz: scene press_slide_lift, seed 1, recorded with version 0.2.0."""
COUNTS = 32_760_262
"""Sum of its counts."""
SENSOR = load_sensor()
OLD_SCHEMA = """\
std_msgs/Header header
uint16 layout_id
uint32 sequence
uint16 rows
uint16 cols
uint16[25] counts
string added_later
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def old_message(sequence: int) -> bytes:
    """A scan of a version with fewer fields, other types, and one field more."""
    head = bytes([0, 1, 0, 0]) + np.array([5, 1000 * sequence, 1], "<u4").tobytes() + b"\0"
    head += b"\0" + np.array([SENSOR.layout.id], "<u2").tobytes()
    head += np.array([sequence], "<u4").tobytes() + np.array([5, 5], "<u2").tobytes()
    head += np.arange(25, dtype="<u2").tobytes()
    return head + bytes(-(len(head) - 4) % 4) + np.array([1], "<u4").tobytes() + b"\0"


def recorded(path: Path, topics: dict[str, tuple[str, str, list[bytes]]]) -> Path:
    file = MessageFile(path, "test")
    for name, (kind, schema, messages) in topics.items():
        topic = file.add_topic(name, kind, schema)
        for time, message in enumerate(messages):
            file.add(topic, time, message)
    file.close()
    return path


def test_a_stored_recording_is_replayed() -> None:
    scans = [scan.snapshot() for scan in RecordedScans(STORED, SENSOR).scans()]
    assert [scan.sequence for scan in scans] == list(range(40))
    assert scans[0].stamp == 1_790_000_000_000_000_000
    assert (scans[-1].stamp - scans[0].stamp) == pytest.approx(39e6, rel=0.01)
    assert sum(int(scan.counts.sum()) for scan in scans) == COUNTS
    model = Reconstructor(SENSOR)
    assert sum(model.process(scan).accepted for scan in scans) >= 39  # one with interference


def test_a_recording_of_another_version_is_read_by_its_schema(tmp_path: Path) -> None:
    path = recorded(tmp_path / "old.mcap", {"/tactile/raw": (RAW, OLD_SCHEMA, [old_message(n) for n in range(3)])})
    source = RecordedScans(path, SENSOR)
    scans = [scan.snapshot() for scan in source.scans()]
    assert source.problem == ""
    assert [(scan.stamp, scan.sequence, scan.frames_lost, scan.status) for scan in scans] == [
        (5_000_000_000 + 1000 * n, n, 0, 0) for n in range(3)
    ]
    assert scans[0].counts.tolist() == list(range(25))
    assert np.isnan([*scans[0].temperatures, scans[0].stamp_uncertainty]).all()


def test_a_scan_that_cannot_be_read_ends_the_replay_in_one_line(tmp_path: Path) -> None:
    messages = [old_message(0), old_message(1)[:40], old_message(2)]
    source = RecordedScans(recorded(tmp_path / "x.mcap", {"/raw": (RAW, OLD_SCHEMA, messages)}), SENSOR)
    assert len(list(source.scans())) == 1
    assert source.problem.endswith("; 1 scans before it were read")
    without = OLD_SCHEMA.replace(" counts\n", " values\n")
    with pytest.raises(ConfigError, match="cannot be read as a scan: 'counts'"):
        RecordedScans(recorded(tmp_path / "y.mcap", {"/raw": (RAW, without, [old_message(0)])}), SENSOR)


def test_the_topic_is_the_only_one_or_must_be_chosen(tmp_path: Path) -> None:
    one = (RAW, OLD_SCHEMA, [old_message(0)])
    path = recorded(tmp_path / "two.mcap", {"/thumb/raw": one, "/index/raw": one})
    with pytest.raises(ConfigError, match=r"has scans on /thumb/raw, /index/raw; choose one: replay_topic:=/thumb/raw"):
        RecordedScans(path, SENSOR)
    assert RecordedScans(path, SENSOR, "index/raw").topic.name == "/index/raw"
    with pytest.raises(ConfigError, match="has no scans on /palm/raw, but on /thumb/raw, /index/raw"):
        RecordedScans(path, SENSOR, "/palm/raw")
    other = recorded(tmp_path / "other.mcap", {"/chatter": ("demo_msgs/Text", "string data", [old_message(0)])})
    with pytest.raises(ConfigError, match=r"has no scans .*, but /chatter; record the topic raw"):
        RecordedScans(other, SENSOR)


def test_the_topics_of_a_sensor_are_those_that_no_other_sensor_has_in_its_namespace(tmp_path: Path) -> None:
    one = (RAW, OLD_SCHEMA, [old_message(0)])
    text = ("demo_msgs/Text", "string data", [bytes([0, 1, 0, 0, 1, 0, 0, 0, 0])])
    others = dict.fromkeys(("/thumb/info", "/index/info", "/hand/info"), text)
    found = RecordedScans(
        recorded(tmp_path / "x.mcap", {"/thumb/raw": one, "/index/raw": one, **others}), SENSOR, "thumb/raw"
    )
    of_sensor = [name for name, topic in found.overview.topics.items() if found.of_sensor(topic)]
    assert of_sensor == ["/thumb/raw", "/thumb/info", "/hand/info"]


@pytest.mark.parametrize("simulated", [True, False])
def test_a_sensor_is_simulated_if_its_own_description_says_so(simulated: bool, tmp_path: Path) -> None:
    infos = {
        f"/{finger}/info": (INFO, "bool simulated", [bytes([0, 1, 0, 0, said])])
        for finger, said in {"index": not simulated, "thumb": simulated}.items()
    }
    one = (RAW, OLD_SCHEMA, [old_message(0)])
    path = recorded(tmp_path / "two.mcap", {**infos, "/index/raw": one, "/thumb/raw": one})
    assert RecordedScans(path, SENSOR, "thumb/raw").simulated() is simulated
    assert RecordedScans(path, SENSOR, "index/raw").simulated() is not simulated


def test_a_recording_that_was_cut_before_its_first_message_says_so(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(STORED.read_bytes()[:500])
    with pytest.raises(ConfigError, match=rf"^{cut}: it ends within a record; 0 messages up to byte \d+ of 500 were"):
        RecordedScans(cut, SENSOR)


def test_scans_of_another_sensor_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"not of layout \d+ of sensor .*sensor_file:=<file>"):
        RecordedScans(STORED, load_sensor("posfet_16x16"))


def source(rate: float = 1.0, path: Path = STORED) -> tuple[ReplaySource, SteppedClock]:
    clock = SteppedClock(now=7_000_000_000)
    replay = ReplaySource(RecordedScans(path, SENSOR), rate, simulated=True, clock=clock)
    replay.open()
    return replay, clock


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_scans_come_at_the_pace_of_their_stamps(rate: float) -> None:
    replay, clock = source(rate)
    times, stamps = [], []
    while not replay.finished:
        scan = replay.read(0.1)
        if scan is not None:
            times.append(clock.now)
            stamps.append(scan.stamp)
    assert np.diff(times).tolist() == pytest.approx((np.diff(stamps) / rate).tolist(), abs=2)
    assert replay.report().state == f"replay of {STORED} finished"
    assert replay.report().scans == 40


def test_a_read_waits_no_longer_than_its_timeout() -> None:
    replay, clock = source(rate=0.01)
    assert replay.read(0.02) is not None
    before = clock.now
    assert replay.read(0.02) is None
    assert clock.now - before == 20_000_000


def test_without_a_pace_no_scan_waits_and_open_begins_again() -> None:
    replay, clock = source(rate=0.0)
    for _ in range(2):
        replay.open()
        scans: list[Scan] = []
        while not replay.finished:
            scan = replay.read(0.0)
            scans += [] if scan is None else [scan.snapshot()]
        assert len(scans) == 40
    assert clock.now == 7_000_000_000
    replay.close()
    assert replay.read(0.5) is None
    assert replay.report().health == Health.STALE


def test_stamps_that_jump_do_not_stop_a_replay(tmp_path: Path) -> None:
    far = LONGEST_PAUSE // 1000 * 2
    path = recorded(
        tmp_path / "x.mcap", {"/raw": (RAW, OLD_SCHEMA, [old_message(n) for n in (5, far // 10**6, 4, 3, 6)])}
    )
    replay, clock = source(path=path)
    while not replay.finished:
        replay.read(0.001)
    assert replay.report().scans == 5
    assert clock.now - 7_000_000_000 < 2 * LONGEST_PAUSE
