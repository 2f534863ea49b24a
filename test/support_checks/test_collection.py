# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A module that is skipped takes no other with it, also beside plug-ins that import what is collected."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.long_cases import long_cases

TESTS = Path(__file__).resolve().parents[1]

PLUGIN = """
import runpy

def pytest_pycollect_makemodule(module_path):
    runpy.run_path(str(module_path))
"""
"""What launch_testing does with each module."""


SKIPPED = "import pytest; pytest.importorskip('absent', reason='absent')"


@pytest.mark.parametrize("first", long_cases([SKIPPED, "import absent"], [SKIPPED]))
def test_a_module_that_is_not_imported_takes_no_other_with_it(tmp_path: Path, first: str) -> None:
    (tmp_path / "conftest.py").symlink_to(TESTS / "conftest.py")
    (tmp_path / "importing.py").write_text(PLUGIN, encoding="utf-8")
    (tmp_path / "test_first.py").write_text(first, encoding="utf-8")
    (tmp_path / "test_second.py").write_text("def test_second():\n    pass\n", encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), str(TESTS), *sys.path])
    command = [sys.executable, "-m", "pytest", "-p", "importing", "--continue-on-collection-errors", str(tmp_path)]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False
    )
    last = done.stdout.splitlines()[-1]
    assert "1 passed" in last, done.stdout
    assert "1 skipped" in last or "1 error" in last, done.stdout


KEPT = """
import pytest, rclpy

kept = []

@pytest.fixture(scope="module")
def node():
    context = rclpy.Context()
    rclpy.init(context=context)
    made = rclpy.create_node("made", context=context)
    yield made
    {end}
    made.destroy_node()
    rclpy.shutdown(context=context)

def test_first(node):
    pass

def test_last():
    pass
"""


@pytest.mark.ros
@pytest.mark.parametrize(
    ("end", "result"),
    long_cases(
        [("pass", "2 passed in"), ("kept.append(made); return", "2 passed, 1 error")],
        [("kept.append(made); return", "2 passed, 1 error")],
    ),
)
def test_a_module_that_keeps_a_node_fails_after_its_fixtures_have_ended(tmp_path: Path, end: str, result: str) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    (tmp_path / "conftest.py").symlink_to(TESTS / "conftest.py")
    (tmp_path / "test_kept.py").write_text(KEPT.format(end=end), encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), str(TESTS), *sys.path])
    command = [sys.executable, "-m", "pytest", str(tmp_path)]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False
    )
    assert result in done.stdout.splitlines()[-1], done.stdout
