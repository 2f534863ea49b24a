# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The groups of one worker exist, and all other tests are distributed one by one."""

from pathlib import Path

from support.worker_scope import LIVE, TOGETHER, scope

HERE = Path(__file__).parents[1]


def test_every_named_file_and_folder_exists() -> None:
    assert all((HERE / name).exists() for name in LIVE + TOGETHER)


def test_live_tests_are_one_scope_and_costly_files_one_each() -> None:
    assert scope("test/stack/test_bringup.py::test_a") == scope("test/driver/ros/test_b.py::test_c[x::y]") == "live"
    assert {scope(f"test/{file}::test_a") for file in TOGETHER} == set(TOGETHER)
    assert scope("test/model/test_adc.py::test_a") == "test/model/test_adc.py::test_a"
