"""Shared by every test: the shipped sensor, and a ROS domain of its own on this machine alone."""

from __future__ import annotations

import os
from contextlib import ExitStack
from importlib.util import find_spec

import pytest
from clocks import POLL
from hypothesis import HealthCheck, settings

from posfet_model.sensor import Sensor, load_sensor

OPTIONAL = {
    "cantools": ["driver/test_codec.py", "driver/test_protocol_document.py"],
    "matplotlib": ["model/test_figures.py", "model/test_stability.py"],
}
"""Tests that are left out where a module is missing; said in the header of the report."""
MISSING = [module for module in OPTIONAL if find_spec(module) is None]
collect_ignore = [name for module in MISSING for name in OPTIONAL[module]]

_isolation = ExitStack()

# The same examples on every machine, however slow it is.
settings.register_profile("posfet", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("posfet")


def pytest_configure() -> None:
    """Take a ROS domain that no other test run on this machine has, for this process and those that it starts."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    try:
        import domain_coordinator  # noqa: PLC0415  # only where there is ROS
    except ImportError:
        return
    os.environ["ROS_DOMAIN_ID"] = str(_isolation.enter_context(domain_coordinator.domain_id()))


def pytest_report_header() -> list[str]:
    return [f"left out, because {module} is not installed: {', '.join(OPTIONAL[module])}" for module in MISSING]


def pytest_unconfigure() -> None:
    _isolation.close()


@pytest.fixture(autouse=True)
def boards_look_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Emulated boards look at their clock often, so that time that waits for them passes also when nothing is due."""
    monkeypatch.setattr("posfet_driver.adapter.IDLE", POLL)
    monkeypatch.setattr("posfet_driver.sim_wire.IDLE", POLL)


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return load_sensor()
