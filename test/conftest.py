"""Configuration shared by all tests: the shipped sensor, a private ROS domain, and worker scheduling."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from importlib.util import find_spec
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from posfet_driver.bus.frame import Frame
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.bus.socketcan_bus import SocketcanFrameBus
from posfet_model.sensor.description import Sensor, load_sensor
from support.clocks import POLL
from support.expected_time import expected, keep
from support.worker_scope import scope

OPTIONAL = {
    "cantools": [
        "driver/protocol/test_scan_codec.py",
        "driver/protocol/test_protocol_document.py",
        "driver/protocol/test_mapped_decoder.py",
        "driver/protocol/test_frame_tables.py",
        "driver/protocol/test_own_frames_document.py",
        "driver/board/test_listening_board.py",
        "driver/tools/test_own_frames_tools.py",
        "driver/ros/test_own_frames_node.py",
    ],
    "matplotlib": ["model/figures/test_figures.py", "model/figures/test_stability.py"],
}
"""Tests that are skipped where a module is missing; stated in the header of the report."""
MISSING = [module for module in OPTIONAL if find_spec(module) is None]
collect_ignore = [name for module in MISSING for name in OPTIONAL[module]]

_isolation = ExitStack()
_begin = time.monotonic()

# The same examples on every machine, without a time limit.
settings.register_profile("posfet", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("posfet")


def pytest_configure() -> None:
    """Reserve a ROS domain that no other test process on this machine uses, for this process and its children.

    Each worker of pytest-xdist is such a process and reserves its own domain.
    """
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    try:
        import domain_coordinator  # noqa: PLC0415  # only where there is ROS
    except ImportError:
        return
    os.environ["ROS_DOMAIN_ID"] = str(_isolation.enter_context(domain_coordinator.domain_id()))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if _is_worker(config):
        items.sort(key=lambda item: scope(item.nodeid) == item.nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    if config.getvalue("dist") != "load":
        return None
    from support.worker_scheduling import ScopeScheduling  # noqa: PLC0415  # only where there is pytest-xdist

    return ScopeScheduling(config, log)


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


@pytest.fixture(autouse=True)
def waits_are_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boards and readers look at their clock often: time that waits for them passes also when nothing is due."""
    monkeypatch.setattr("posfet_sim.emulation.slcan_adapter.IDLE", POLL)
    monkeypatch.setattr("posfet_sim.emulation.bus_server.IDLE", POLL)
    for bus in (PythonCanFrameBus, SlcanBus, SocketcanFrameBus):
        monkeypatch.setattr(bus, "read_frames", _shortly(bus.read_frames))


def _shortly(read_frames: Callable[[Any, float], list[Frame]]) -> Callable[[Any, float], list[Frame]]:
    return lambda bus, timeout: read_frames(bus, min(timeout, POLL))


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return load_sensor()
