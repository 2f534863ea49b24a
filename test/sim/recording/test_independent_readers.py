# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Two readers that are not of this project decode recordings by the definitions in them, field by field alike."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mcap")
pytest.importorskip("mcap_ros2", reason="pip install mcap-ros2-support")
pytest.importorskip("rosbags", reason="pip install rosbags")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from posfet.replay_command import main as replay
from posfet_sim.commands.simulate import main as simulate
from posfet_sim.recording.mcap_reader import Recording
from support.paths import DATA

STORED = DATA / "recording" / "posfet_0.2.0.mcap"


def fields(message: Any) -> Iterator[tuple[str, Any]]:
    """Yield names and values of a message of rosbags, whose constants are in capitals."""
    for name in message.__dataclass_fields__:
        if not name.startswith("__") and not name.isupper():
            yield name, getattr(message, name)


def assert_same(value: Any, other: Any, ours: Any, place: str) -> None:
    """Compare a value by rosbags with those by mcap-ros2-support and by this stack."""
    if hasattr(value, "__dataclass_fields__"):
        for name, inner in fields(value):
            # This stack has times as nanoseconds.
            own = ours[name] if isinstance(ours, dict) else ours
            assert_same(inner, getattr(other, name), own, f"{place}.{name}")
    elif isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.dtype == object):
        assert len(value) == len(other), place
        for index, (one, two) in enumerate(zip(value, other, strict=True)):
            assert_same(one, two, ours[index] if isinstance(ours, list) else ours, f"{place}[{index}]")
    elif place.endswith((".sec", ".nanosec")):
        assert value == other, place
    else:
        octets = isinstance(other, bytes)  # how mcap-ros2-support gives uint8[]
        np.testing.assert_array_equal(value, list(other) if octets else other, err_msg=place)
        np.testing.assert_array_equal(value, ours, err_msg=place)


@pytest.fixture(params=["stored by an earlier version", "simulated", "replayed"])
def recording(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "stored by an earlier version":
        return STORED
    path, replayed = tmp_path / "run.mcap", tmp_path / "replayed.mcap"
    assert simulate(["press", "--out", str(path), "--for", "0.6"]) == 0
    if request.param == "simulated":
        return path
    assert replay([str(path), "--out", str(replayed)]) == 0
    return replayed


def test_independent_readers_and_this_one_decode_the_same(recording: Path) -> None:
    ours = [(each.topic.name, each.topic.reader.read(each.data)) for each in Recording(recording).messages()]
    with recording.open("rb") as file:
        decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        others = [(channel.topic, message) for _, channel, _, message in decoded]
    with AnyReader([recording]) as reader:
        third = [(at.topic, reader.deserialize(raw, at.msgtype)) for at, _, raw in reader.messages()]
    assert [name for name, _ in ours] == [name for name, _ in others] == [name for name, _ in third]
    assert ours
    for (name, value), (_, other), (_, own) in zip(third, others, ours, strict=True):
        assert_same(value, other, own, name)
