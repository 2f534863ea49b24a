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
