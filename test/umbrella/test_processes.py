# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the exit codes of several node processes mean for the one that started them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("ament_index_python", reason="needs ROS 2")

from posfet.processes import Processes
from posfet_model.ros.exit_codes import PROCESS_FAILED


@pytest.mark.parametrize(
    ("codes", "expected"),
    [([0, None], 0), ([None], 0), ([0, 1], 1), ([-9, 0], 1), ([1, PROCESS_FAILED], PROCESS_FAILED)],
)
def test_exit_code_of_several_processes(codes: list[int | None], expected: int) -> None:
    processes = Processes([])
    processes._running = [SimpleNamespace(returncode=code) for code in codes]
    assert processes.exit_code() == expected


def test_a_node_that_ended_without_a_word_of_its_own_is_named() -> None:
    processes = Processes([])
    names = ("model_node", "driver_node", "sim_board_node", "replay_node", "palm")
    processes._commands = [(SimpleNamespace(name=name), []) for name in names]  # type: ignore[misc]
    processes._running = [SimpleNamespace(returncode=code) for code in (None, -9, 0, 1, -40)]  # type: ignore[misc]
    assert processes.silent_ends() == [
        "driver_node was killed by SIGKILL: the stack ends with it",
        "sim_board_node has ended: the stack ends with it",
        "palm was killed by signal 40: the stack ends with it",
    ]
