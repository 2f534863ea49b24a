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
