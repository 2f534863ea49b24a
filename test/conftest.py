"""Shared by every test: the shipped sensor, and an isolated ROS domain on this machine alone."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from posfet_model.sensor import Sensor, load_sensor


def pytest_configure() -> None:
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return load_sensor()


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    """A ROS domain that no other test run on this machine has, for this process and those that it starts."""
    domain_coordinator = pytest.importorskip("domain_coordinator", reason="needs ROS 2")
    with domain_coordinator.domain_id() as domain:
        before = os.environ.get("ROS_DOMAIN_ID")
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        yield domain
        if before is None:
            del os.environ["ROS_DOMAIN_ID"]
        else:
            os.environ["ROS_DOMAIN_ID"] = before
