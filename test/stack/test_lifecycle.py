# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The transitions of a whole stack: by services of a started one, and by the example of a launch file."""

from __future__ import annotations

import signal
from importlib.util import find_spec

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically

from posfet_msgs.msg import TactileContacts, TactileInfo
from support.bringup_process import needs_installation, running
from support.expectations import Listener
from support.launched import launched, launching, wait_until_ended
from support.long_cases import long_cases
from support.paths import EXAMPLES

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]


def state(listener: Listener, node: str) -> str:
    return listener.call(GetState, f"{node}/get_state", GetState.Request(), repeat=True).current_state.label


def change(listener: Listener, node: str, transition: int, repeat: bool = False) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return listener.call(ChangeState, f"{node}/change_state", request, repeat).success


@pytest.mark.parametrize("composed", long_cases(["true", "false"], ["false"]))
def test_a_stack_waits_for_transitions_and_is_tuned_while_it_runs(composed: str) -> None:
    words = ["autostart:=false", "frame_id:=finger", f"composed:={composed}", "namespace:=steps"]
    nodes = ("model_node", "sim_board_node")
    with running(*words), Listener("steps") as listener:
        contacts = listener.collect(TactileContacts, "contacts")
        info = listener.collect(TactileInfo, "info", transient_local=True)
        diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
        for node in nodes:
            assert state(listener, node) == "unconfigured"
            assert not change(listener, node, Transition.TRANSITION_ACTIVATE, repeat=True)
            assert change(listener, node, Transition.TRANSITION_CONFIGURE)
            assert state(listener, node) == "inactive"
        assert not contacts
        for node in nodes:
            assert change(listener, node, Transition.TRANSITION_ACTIVATE)
        listener.wait(lambda: any(message.contacts for message in contacts), "a contact")
        listener.wait(lambda: bool(info), "info")
        assert (contacts[-1].header.frame_id, info[-1].header.frame_id) == ("finger", "finger")

        values = {"contact_threshold": 50.0, "release_threshold": 20.0}
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value))
                for name, value in values.items()
            ]
        )
        service = "model_node/set_parameters_atomically"
        result = listener.call(SetParametersAtomically, service, request, repeat=True).result
        assert result.successful, result.reason
        listener.wait(lambda: not contacts[-1].contacts, "an end of contacts above the new threshold")
        assert contacts[-1].threshold == pytest.approx(50.0)
        listener.wait(lambda: info[-1].contact_threshold == pytest.approx(50.0), "the new thresholds in info")

        names = {"steps/model_node: reconstruction", "steps/sim_board_node: board"}
        listener.wait(lambda: names <= {each.status[0].name for each in diagnostics}, "diagnostics")
        assert {each.status[0].hardware_id for each in diagnostics} == {"posfet_5x5 (steps)"}
        assert change(listener, "model_node", Transition.TRANSITION_DEACTIVATE)
        diagnostics.clear()
        listener.wait(
            lambda: any(each.status[0].message.startswith("inactive") for each in diagnostics), "diagnostics: inactive"
        )
        assert change(listener, "model_node", Transition.TRANSITION_ACTIVATE)
        contacts.clear()
        listener.wait(lambda: bool(contacts), "contacts after deactivate and activate")


needs_launch_ros = pytest.mark.skipif(
    find_spec("launch_ros") is None, reason="needs launch_ros; the test above makes the transitions"
)


@needs_launch_ros
def test_the_example_of_a_launch_file_brings_the_nodes_up_step_by_step() -> None:
    with launching(EXAMPLES / "lifecycle.launch.py"), Listener() as listener:
        contacts = listener.collect(TactileContacts, "contacts")
        listener.wait(lambda: any(message.contacts for message in contacts), "a contact")
        assert {state(listener, node) for node in ("model_node", "sim_board_node")} == {"active"}


@needs_launch_ros
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_node_of_the_example_outlives_its_launch(number: signal.Signals) -> None:
    with launched(EXAMPLES / "lifecycle.launch.py") as launch, Listener() as listener:
        contacts = listener.collect(TactileContacts, "contacts")
        listener.wait(lambda: bool(contacts), "contacts")
        nodes = launch.nodes()
        assert len(nodes) == 2
        launch.process.send_signal(number)
        wait_until_ended(nodes)
