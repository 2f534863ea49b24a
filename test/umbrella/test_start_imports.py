# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a command imports, and that the linear algebra of NumPy has one thread in it."""

from __future__ import annotations

import gc
import importlib.util
import os
import subprocess
import sys

import pytest

from posfet_model.ros.start import BLAS_THREADS, limit_blas_threads, loading


def python(code: str, **variables: str) -> str:
    """Return what a fresh interpreter prints; variables that limit threads are not inherited."""
    environment = {name: value for name, value in os.environ.items() if name not in BLAS_THREADS}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, env=environment | variables, capture_output=True, text=True, check=True, timeout=120)
    return run.stdout


@pytest.fixture
def unlimited(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in BLAS_THREADS:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("unlimited")
def test_linear_algebra_has_one_thread_by_default() -> None:
    limit_blas_threads()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


@pytest.mark.usefixtures("unlimited")
@pytest.mark.parametrize("name", BLAS_THREADS)
def test_a_number_of_threads_that_the_user_has_set_is_kept(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv(name, "3")
    limit_blas_threads()
    assert {each: os.environ.get(each) for each in BLAS_THREADS} == {
        each: "3" if each == name else None for each in BLAS_THREADS
    }


def test_a_command_is_chosen_before_numpy_is_imported() -> None:
    assert python("import sys, posfet.cli; print('numpy' in sys.modules)") == "False\n"


RUN = """
import contextlib, io, os, sys
from posfet.cli import main
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main(["score", "--help"])
assert "numpy" in sys.modules
print(os.environ["OPENBLAS_NUM_THREADS"], len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="needs Linux")
def test_a_command_runs_with_one_thread() -> None:
    assert python(RUN) == "1 1\n"
    assert python(RUN, OPENBLAS_NUM_THREADS="2").startswith("2 ")


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="needs rclpy")
def test_bring_up_without_terminal_and_page_needs_neither_their_packages_nor_those_of_a_bus() -> None:
    loaded = python(
        "import sys, posfet.bringup, posfet.composed_node, posfet.composed_graph, posfet.display_loop\n"
        "import posfet_model.ros.model_node, posfet_sim.ros.sim_board_node\n"
        "print(*sorted({'can', 'cantools', 'http.server', 'rich', 'scipy'} & set(sys.modules)))"
    )
    assert loaded == "\n"


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="needs rclpy")
def test_the_first_node_needs_neither_model_nor_simulation() -> None:
    """Others discover its participant while these are loaded."""
    loaded = python(
        "import sys, posfet.composed_node\n"
        "print(*sorted({'posfet_model.ros.model_node', 'posfet_sim.ros.sim_board_node'} & set(sys.modules)))"
    )
    assert loaded == "\n"


@pytest.mark.parametrize("enabled", [True, False])
def test_modules_are_loaded_without_the_garbage_collector(enabled: bool) -> None:
    before = gc.isenabled()
    (gc.enable if enabled else gc.disable)()
    try:
        with pytest.raises(ModuleNotFoundError), loading():
            assert not gc.isenabled()
            importlib.import_module("no_such_module")
        assert gc.isenabled() == enabled
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()
        (gc.enable if before else gc.disable)()
