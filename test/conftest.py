"""Shared by every test: the shipped sensor, and a ROS domain of its own on this machine alone."""

from __future__ import annotations

import os
from contextlib import ExitStack

import pytest
from hypothesis import HealthCheck, settings

from posfet_model.sensor import Sensor, load_sensor

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


def pytest_unconfigure() -> None:
    _isolation.close()


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return load_sensor()
