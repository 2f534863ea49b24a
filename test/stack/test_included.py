# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The launch file in a robot's launch: namespaces, remaps, parameters, faults of ours, and its end by any signal."""

from __future__ import annotations

import signal
import subprocess
import time
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("launch", reason="needs launch; test_bringup.py passes the same ROS arguments to the executable")
pytest.importorskip("launch_ros", reason="needs launch_ros")

from launch import LaunchContext
from launch.actions import ExecuteProcess, LogInfo, Shutdown, TimerAction
from launch.launch_description_sources import load_python_launch_file_as_module
from rcl_interfaces.srv import GetParameters

from posfet_model.ros.exit_codes import PROCESS_FAILED
from posfet_msgs.msg import TactileContacts
from support.bringup_process import needs_installation
from support.expectations import TIMEOUT, Listener
from support.launched import Launch, children, launched, wait_until_ended
from support.page_stream import first_frame, link_in
from support.paths import LAUNCH

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

LAUNCH_FILE = LAUNCH / "bringup.launch.py"
HAND_FILE = LAUNCH / "hand.launch.py"
BAD = ("scene:=nowhere", "namespace:=9")
ROBOT = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import ExecuteProcess, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace, SetParameter, SetRemap

file, *words = sys.argv[1:]
included = IncludeLaunchDescription(
    PythonLaunchDescriptionSource(file), launch_arguments=[word.split(":=") for word in words]
)
group = GroupAction([
    PushRosNamespace("robot"), SetRemap("contacts", "touch"), SetParameter("use_sim_time", True),
    SetParameter("robot_name", "r2"), included,
])
others = ExecuteProcess(cmd=["cat"])  # ends with the launch, whose pipe it reads
service = LaunchService(noninteractive=True)
service.include_launch_description(LaunchDescription([others, group]))
sys.exit(service.run())
"""


def robot(*words: str, file: Path = LAUNCH_FILE) -> AbstractContextManager[Launch]:
    """Run a robot's launch file that includes one of ours."""
    return launched(file, *words, program=ROBOT)


@pytest.mark.parametrize(("composed", "number"), [("true", signal.SIGTERM), ("false", signal.SIGKILL)])
def test_an_included_stack_is_moved_remapped_and_ends_with_the_launch(composed: str, number: signal.Signals) -> None:
    # Texts that a parameter file without quotes would turn into a number.
    texts = {"serial": "0815", "frame_id": "1e5"}
    words = [f"composed:={composed}", *(f"{name}:={text}" for name, text in texts.items())]
    with robot(*words) as launch, Listener("robot/tactile") as listener:
        contacts = listener.collect(TactileContacts, "touch")
        listener.wait(lambda: any(message.contacts for message in contacts), "a contact")
        assert contacts[-1].header.frame_id == texts["frame_id"]
        for name in ("model_node", "sim_board_node"):
            request = GetParameters.Request(names=["use_sim_time", "serial"])
            simulated, serial = listener.call(GetParameters, f"{name}/get_parameters", request).values
            assert simulated.bool_value
            assert serial.string_value == texts["serial"]
        nodes = launch.nodes()
        assert len(nodes) == (1 if composed == "true" else 2)
        launch.process.send_signal(number)
        wait_until_ended(nodes)


def test_a_killed_stack_is_started_again_with_all_that_the_launch_gave_it() -> None:
    with robot("respawn:=always") as launch, Listener("robot/tactile") as listener:
        contacts = listener.collect(TactileContacts, "touch")
        listener.wait(lambda: bool(contacts), "contacts")
        first = launch.nodes()
        subprocess.run(["kill", "-KILL", *map(str, first)], check=True)
        wait_until_ended(first)
        # Its command is that of the first, once it no longer is a copy of launch.
        listener.wait(lambda: list(launch.nodes().values()) == list(first.values()), "the same process again")
        contacts.clear()
        listener.wait(lambda: bool(contacts), "contacts of the process that was started again")


@pytest.fixture
def log_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the launch's log files; ports and tokens are of no other test."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    return tmp_path / "log"


def expect_page(launch: Launch, sensors: int, log_folder: Path) -> None:
    """Expect a link to a page that shows every sensor, and its token in no log file."""
    launch.wait_for("in a browser on this machine: ")
    port, token = link_in(launch.printed()) or pytest.fail("no link")
    assert len(first_frame(port, token, all)) == sensors
    logs = [path for path in log_folder.rglob("*") if path.is_file()]
    assert logs
    assert not [path for path in logs if token in path.read_text(encoding="utf-8", errors="replace")]


def test_an_included_stack_is_shown_in_a_browser(log_folder: Path) -> None:
    with robot("web:=true") as launch:
        expect_page(launch, 1, log_folder)


def test_all_sensors_of_an_included_hand_are_shown_on_one_page_without_which_they_go_on(
    tmp_path: Path, log_folder: Path
) -> None:
    hand = tmp_path / "hand.yaml"
    hand.write_text("sensors: [{name: thumb, serial: a}, {name: palm, serial: b, composed: false}]", encoding="utf-8")
    with robot(f"hand:={hand}", "web:=true", file=HAND_FILE) as launch, Listener("robot/palm") as listener:
        expect_page(launch, 2, log_folder)
        nodes = launch.nodes()
        views = {pid: line for pid, line in nodes.items() if "lib/posfet/view " in line}
        assert (len(nodes), len(views)) == (4, 1)
        subprocess.run(["kill", "-KILL", *map(str, views)], check=True)
        wait_until_ended(views)
        contacts = listener.collect(TactileContacts, "touch")
        listener.wait(lambda: bool(contacts), "contacts without the page")
        assert launch.nodes() == {pid: line for pid, line in nodes.items() if pid not in views}


@pytest.mark.parametrize(
    ("file", "words"),
    [
        *((LAUNCH_FILE, (f"composed:={each}", word)) for each in ("true", "false") for word in BAD),
        *((HAND_FILE, (word,)) for word in ("hand:=nowhere", "web:=on")),
    ],
)
def test_a_stack_that_is_not_required_fails_alone(file: Path, words: tuple[str, ...]) -> None:
    with robot("required:=false", *words, file=file) as launch:
        launch.wait_for("the rest goes on (required:=false)")
        end = time.monotonic() + TIMEOUT
        while not any(line.startswith("cat") for line in children(launch.process.pid).values()):
            assert time.monotonic() < end
            time.sleep(0.01)
        assert launch.process.poll() is None


def actions(code: int, *, required: bool = True, respawn: str = "on_internal_error", stopping: bool = False) -> Any:
    """Return what the launch file does when a process ends with an exit code."""
    file = load_python_launch_file_as_module(str(LAUNCH_FILE))
    context = LaunchContext()
    context._set_is_shutdown(stopping)
    event = SimpleNamespace(process_name="bringup-1", returncode=code, cmd=["true"], cwd=None, env={})
    return file.on_exit(required, respawn)(event, context)


@pytest.mark.parametrize(
    ("code", "options", "kinds"),
    [
        (PROCESS_FAILED, {}, [ExecuteProcess]),
        (PROCESS_FAILED, {"required": False}, [ExecuteProcess]),
        (PROCESS_FAILED, {"required": False, "respawn": "never"}, [LogInfo]),
        (0, {}, [Shutdown]),
        (-signal.SIGTERM, {}, [Shutdown]),
        (-signal.SIGKILL, {"required": False}, [LogInfo]),
        (0, {"required": False}, [LogInfo]),
        (1, {"required": False}, [LogInfo]),
        (1, {"respawn": "always"}, [TimerAction]),
        (PROCESS_FAILED, {"respawn": "always"}, [ExecuteProcess]),
        (0, {"stopping": True}, []),
        (1, {"stopping": True, "respawn": "always"}, []),
    ],
)
def test_what_follows_the_end_of_a_process(code: int, options: dict[str, Any], kinds: list[type]) -> None:
    assert [type(action) for action in actions(code, **options)] == kinds


@pytest.mark.parametrize(
    ("code", "respawn"), [(1, "on_internal_error"), (PROCESS_FAILED, "never"), (-signal.SIGKILL, "never")]
)
def test_a_required_process_that_failed_for_good_fails_the_launch(code: int, respawn: str) -> None:
    with pytest.raises(RuntimeError, match=f"bringup-1 failed with exit code {code:d}"):
        actions(code, respawn=respawn)
