"""Shared by every test: the shipped sensor, a ROS domain of its own on this machine alone, and what one worker runs."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import pytest
from expected_time import expected, keep
from hypothesis import HealthCheck, settings

from posfet_model.sensor import Sensor, load_sensor

OPTIONAL = {
    "cantools": ["driver/test_codec.py", "driver/test_protocol_document.py"],
    "matplotlib": ["model/test_figures.py", "model/test_stability.py"],
}
"""Tests that are left out where a module is missing; said in the header of the report."""
MISSING = [module for module in OPTIONAL if find_spec(module) is None]
collect_ignore = [name for module in MISSING for name in OPTIONAL[module]]

HERE = Path(__file__).resolve().parent
LIVE = ("nodes/", "stack/", "driver/test_arrays.py", "driver/test_hardware.py", "driver/test_long_runs.py")
"""Nodes and processes that have to keep up with a clock: one worker runs them all, so that they do not take the
processors from each other.
"""
TOGETHER = ("simulation/test_calibration.py", "simulation/test_score.py", "simulation/test_bench_recording.py")
"""Files with a fixture that takes seconds to make: one worker runs each of them."""

_isolation = ExitStack()
_begin = time.monotonic()

# The same examples on every machine, however slow it is.
settings.register_profile("posfet", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("posfet")


def pytest_configure(config: pytest.Config) -> None:
    """Take a ROS domain that no other test process on this machine has, for this one and those that it starts.

    The workers of pytest-xdist are such processes: each takes a domain of its own.
    """
    if not config.pluginmanager.hasplugin("xdist"):
        config.addinivalue_line("markers", "xdist_group(name): one worker of pytest-xdist runs these tests")
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    try:
        import domain_coordinator  # noqa: PLC0415  # only where there is ROS
    except ImportError:
        return
    os.environ["ROS_DOMAIN_ID"] = str(_isolation.enter_context(domain_coordinator.domain_id()))


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the marks in the same hook
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Say what one worker runs, and let workers begin with it: what is left is shared test by test."""
    if not _is_worker(config):
        return
    for item in items:
        file = item.path.relative_to(HERE).as_posix()
        if file.startswith(LIVE):
            item.add_marker(pytest.mark.xdist_group("live"))
        elif file in TOGETHER:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    items.sort(key=lambda item: item.get_closest_marker("xdist_group") is None)


def _is_worker(config: pytest.Config) -> bool:
    return hasattr(config, "workerinput")


def pytest_report_header(config: pytest.Config) -> list[str]:
    left_out = [f"left out, because {module} is not installed: {', '.join(OPTIONAL[module])}" for module in MISSING]
    return [*left_out, *filter(None, [expected(config)])]


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    if exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED) and not _is_worker(session.config):
        keep(session.config, time.monotonic() - _begin)


def pytest_unconfigure() -> None:
    _isolation.close()


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return load_sensor()
