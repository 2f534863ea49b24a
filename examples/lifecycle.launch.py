# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Model and simulated board, brought up step by step: the board starts once the model is ready for its scans.

`ros2 launch posfet lifecycle.launch.py`; a robot's own conditions may stand where this file waits for a state.
"""

import os

from launch import LaunchDescription
from launch.actions import EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from posfet_model.ros.start import PARENT

NAMESPACE = "tactile"


def lifecycle_node(package: str, executable: str, **parameters: object) -> LifecycleNode:
    """Return a node that waits for transitions."""
    return LifecycleNode(
        package=package,
        executable=executable,
        name=executable,
        namespace=NAMESPACE,
        parameters=[{"autostart": False, **parameters}],
        output="screen",
        additional_env={PARENT: str(os.getpid())},  # ends with `ros2 launch`, even if that is killed
    )


def change(node: LifecycleNode, transition: int) -> EmitEvent:
    """Return the action that requests a transition of a node."""
    return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))


def reached(node: LifecycleNode, start: str, goal: str, then: EmitEvent) -> RegisterEventHandler:
    """Return the handler that acts when a node has come from one state to another."""
    return RegisterEventHandler(
        OnStateTransition(target_lifecycle_node=node, start_state=start, goal_state=goal, entities=[then])
    )


def generate_launch_description() -> LaunchDescription:
    """Return configure and activate of the model, then of the board."""
    model = lifecycle_node("posfet_model", "model_node", simulated=True)
    board = lifecycle_node("posfet_sim", "sim_board_node")
    configure, activate = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
    return LaunchDescription(
        [
            reached(model, "configuring", "inactive", change(model, activate)),
            reached(model, "activating", "active", change(board, configure)),
            reached(board, "configuring", "inactive", change(board, activate)),
            model,
            board,
            change(model, configure),
        ]
    )
