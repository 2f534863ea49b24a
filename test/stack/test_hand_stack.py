# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The sensors of the shipped hand side by side: each has its namespace, frame, serial number and calibration."""

from __future__ import annotations

from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.context import Context

import posfet.bringup
from posfet.hand import read_hand
from posfet_model.calibration.calibration_file import save_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import load_sensor, with_serial
from posfet_msgs.msg import TactileContacts, TactileInfo
from support.bringup_process import needs_installation
from support.expectations import Listener
from support.launched import launching
from support.paths import LAUNCH, SOURCES

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

HAND = SOURCES / "posfet/config/hand.yaml"


@pytest.fixture
def calibrated_hand(tmp_path: Path) -> Path:
    """Return the shipped hand at rest, its thumb with a calibration, its palm with a serial number of digits only."""
    thumb = with_serial(load_sensor(), "SIM-T")
    save_calibration(tmp_path / "thumb.yaml", thumb, Calibration.nominal(thumb))
    text = HAND.read_text(encoding="utf-8")
    for old, new in (
        ("source: sim", "source: sim\n  scene: idle"),
        ("serial: SIM-T", "serial: SIM-T\n    calibration_file: thumb.yaml"),
        ("serial: SIM-P", "serial: '4711'\n    composed: false"),
    ):
        text = text.replace(old, new)
    path = tmp_path / "hand.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def expect_every_sensor(hand: Path) -> None:
    """Expect description and contacts of each sensor under its own name."""
    sensors = read_hand(hand)
    with Listener("") as listener:
        infos = [listener.collect(TactileInfo, f"/{each['namespace']}/info", transient_local=True) for each in sensors]
        contacts = [listener.collect(TactileContacts, f"/{each['namespace']}/contacts") for each in sensors]
        listener.wait(lambda: all([*infos, *contacts]), "info and contacts of every sensor")
    for sensor, info, found in zip(sensors, infos, contacts, strict=True):
        frame = f"{sensor['namespace'].replace('/', '_')}_array"
        assert (info[0].header.frame_id, info[0].serial) == (frame, sensor["serial"])
        assert found[0].header.frame_id == frame
        assert info[0].rows == (16 if sensor["namespace"] == "hand/palm" else 5)


def test_six_sensors_in_one_process(calibrated_hand: Path) -> None:
    context = Context()
    rclpy.init(context=context)
    with ExitStack() as stack:
        stack.callback(rclpy.shutdown, context=context)
        for sensor in read_hand(calibrated_hand):
            stack.enter_context(posfet.bringup.nodes(context, **sensor))
        expect_every_sensor(calibrated_hand)


@pytest.mark.skipif(find_spec("launch_ros") is None, reason="needs launch_ros; the same sensors run in one process")
def test_the_launch_file_starts_every_sensor(calibrated_hand: Path) -> None:
    with launching(LAUNCH / "hand.launch.py", f"hand:={calibrated_hand}"):
        expect_every_sensor(calibrated_hand)
