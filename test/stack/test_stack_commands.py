# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Commands for a running stack: tare, scene, diagnostics; and whether the middleware carries messages."""

from __future__ import annotations

import subprocess
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from posfet import stack_commands
from posfet_msgs.msg import TactileContacts
from support.bringup_process import needs_installation, running
from support.expectations import TIMEOUT, Listener

pytestmark = pytest.mark.ros


def posfet(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own: the settings of its middleware are those of a process."""
    return subprocess.run(["posfet", *words], capture_output=True, text=True, timeout=TIMEOUT, check=False)


@pytest.mark.process
@needs_installation
def test_a_running_stack_is_tared_shown_and_given_another_scene() -> None:
    sensor = ["--namespace", "/robot/thumb"]
    with running("scene:=hold", "imperfections:=none", "namespace:=robot/thumb") as stack, Listener() as listener:
        contacts = listener.collect(TactileContacts, "/robot/thumb/contacts")
        listener.wait(lambda: any(message.data_valid and message.contacts for message in contacts), "a contact")
        refused = posfet("tare", *sensor)
        assert refused.returncode == 1
        assert refused.stderr.startswith("refused under load: ")
        loaded = posfet("scene", "idle", *sensor)
        assert (loaded.returncode, loaded.stdout) == (0, "scene 'idle' from its start\n")
        tared = posfet("tare", "--force", *sensor)
        assert (tared.returncode, tared.stdout.count("\n")) == (0, 1), tared.stderr
        shown = posfet("diagnostics", *sensor, "--values")
        assert "robot/thumb/model_node: reconstruction: " in shown.stdout, shown.stderr
        assert "      scene: idle" in shown.stdout
        doctor = posfet("doctor")
        assert "message between two participants after " in doctor.stdout
        assert stack.poll() is None


@pytest.mark.process
@needs_installation
def test_without_a_stack_a_command_says_how_to_start_one() -> None:
    result = posfet("diagnostics", "--namespace", "nobody", "--wait", "0.2")
    assert result.returncode == 1
    assert result.stderr == "no diagnostics of nobody within 0.2 s; start the stack with posfet bringup\n"


@pytest.mark.parametrize(
    ("last", "services", "remedy"),
    [
        ("tare", ["/b/tare", "/a/tare", "/index/tare", "/c/other"], "running are /a, /b: choose with --namespace"),
        ("load", ["/a/scene/load", "/a/calibration/load"], "running are /a: choose with --namespace"),
        ("tare", ["/index/tare"], "is the stack running? Start it with posfet bringup; posfet doctor checks"),
    ],
)
def test_a_missing_service_is_answered_with_those_that_are_there(last: str, services: list[str], remedy: str) -> None:
    node = SimpleNamespace(
        clients=[SimpleNamespace(srv_name="/index/tare")],
        get_service_names_and_types=lambda: [(name, []) for name in services],
    )
    assert stack_commands._remedy(node, last).startswith(remedy)


def test_the_scenes_are_listed(capfd: pytest.CaptureFixture[str]) -> None:
    assert stack_commands.scene([]) == 0
    assert "press_slide_lift" in capfd.readouterr().out.splitlines()


def test_the_worst_status_is_first() -> None:
    pairs = [KeyValue(key="rate", value="7"), KeyValue(key="fault: supply low", value="check its supply")]
    statuses = [
        DiagnosticStatus(level=bytes([level]), name=name, message="m", values=pairs[:count])
        for level, name, count in ((0, "a", 1), (2, "c", 1), (1, "b", 2))
    ]
    remedy = "      fault: supply low: check its supply"
    assert stack_commands.lines(statuses, values=False) == ["ERROR c: m", "WARN  b: m", remedy, "OK    a: m"]
    assert stack_commands.lines(statuses[:1], values=True) == ["OK    a: m", "      rate: 7"]
