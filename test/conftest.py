# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Configuration shared by all tests: the shipped sensor, a private ROS domain, and worker scheduling."""

from __future__ import annotations

import fcntl
import os
import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack
from importlib.abc import MetaPathFinder
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.ros.start import loading
from posfet_model.sensor.description import Sensor, load_sensor
from support import interrupts
from support.clocks import POLL
from support.expected_time import expected, keep
from support.participants import participants_kept
from support.worker_scope import scope

OPTIONAL = ("cantools", "matplotlib", "posfet_driver", "posfet_sim", "posfet")
"""Without one of these, the tests that import it are skipped; a released package is tested without those above it."""
MISSING = {name for name in OPTIONAL if find_spec(name) is None}


class SkipWithout(MetaPathFinder):
    """Skips what imports a missing module."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> None:
        if fullname in MISSING:
            pytest.skip(f"needs {fullname}", allow_module_level=True)


sys.meta_path.append(SkipWithout())

_isolation = ExitStack()
_begin = time.monotonic()

# The same examples on every machine, without a time limit.
settings.register_profile("posfet", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("posfet")


MARKERS = (
    "ros: needs rclpy and the built posfet_msgs",
    "process: starts real processes and waits for their topics",
    "spice: needs ngspice on PATH",
    "slow: takes long, or measures against the wall clock, on a machine with nothing else to do; run by make soak",
    "vm: needs the CAN interfaces of the virtual machine, or the emulated Cortex-M board; run by make test-vm",
)
WARNINGS = (
    "error",
    # launch leaves the socket pair of its event loop to the garbage collector.
    "ignore:Exception ignored in. <socket.socket:pytest.PytestUnraisableExceptionWarning",
)


def pytest_configure(config: pytest.Config) -> None:
    """Reserve a ROS domain that no other test process on this machine uses, for this process and its children.

    Each worker of pytest-xdist is such a process and reserves its own domain.
    """
    for marker in MARKERS:
        config.addinivalue_line("markers", marker)
    for warning in WARNINGS:
        config.addinivalue_line("filterwarnings", warning)
    interrupts.restore()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    try:
        import domain_coordinator  # noqa: PLC0415  # only where there is ROS
    except ImportError:
        return
    os.environ["ROS_DOMAIN_ID"] = str(_isolation.enter_context(domain_coordinator.domain_id()))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if _is_worker(config):
        items.sort(key=lambda item: scope(item.nodeid) == item.nodeid)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Keep the tests out of the garbage collector's sight, which would search them again and again: they stay."""
    with loading():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, Any]:
    """Let one worker compile a module; the others wait, and read what it has stored."""
    if not isinstance(collector, pytest.Module) or not _is_worker(collector.config) or sys.dont_write_bytecode:
        return (yield)
    with collector.path.open() as module:
        fcntl.flock(module, fcntl.LOCK_EX)
        return (yield)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    if config.getvalue("dist") != "load":
        return None
    from support.worker_scheduling import ScopeScheduling  # noqa: PLC0415  # only where there is pytest-xdist

    return ScopeScheduling(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> Generator[None, Any, Any]:
    """Let a module that is skipped, or cannot be imported, be that alone.

    The plug-in of launch_testing imports each module to see whether it has a launch description. What the module then
    raises would count for all that is collected: a package whose first module is skipped would run no test, and pass.
    """
    try:
        return (yield)
    except (Exception, pytest.skip.Exception):
        return pytest.Module.from_parent(parent, path=module_path)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, Any, Any]:
    """No module leaves a participant of the middleware behind: many in one process slow each other down and lock up.

    pytest before 8 may end a fixture of this file before one of the module, whatever began first.
    """
    result = yield
    if nextitem is None or nextitem.path != item.path:
        assert not participants_kept(), "a node of this module was not destroyed, or its context not shut down"
    return result


def _is_worker(config: pytest.Config) -> bool:
    return hasattr(config, "workerinput")


def pytest_report_header(config: pytest.Config) -> list[str]:
    left_out = [f"not installed, tests that need them are skipped: {', '.join(sorted(MISSING))}"] if MISSING else []
    return [*left_out, *filter(None, [expected(config)])]


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    if exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED) and not _is_worker(session.config):
        keep(session.config, time.monotonic() - _begin)


def pytest_unconfigure() -> None:
    _isolation.close()


@pytest.fixture(autouse=True)
def waits_are_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boards and readers look at their clock often: time that waits for them passes also when nothing is due."""
    if "posfet_sim" not in MISSING:
        monkeypatch.setattr("posfet_sim.emulation.slcan_adapter.IDLE", POLL)
        monkeypatch.setattr("posfet_sim.emulation.bus_server.IDLE", POLL)
    if "posfet_driver" not in MISSING:
        for name in ("python_can_bus:PythonCanFrameBus", "slcan_bus:SlcanBus", "socketcan_bus:SocketcanFrameBus"):
            bus = resolve_name(f"posfet_driver.bus.{name}")
            monkeypatch.setattr(bus, "read_frames", _shortly(bus.read_frames))


def _shortly(read_frames: Callable[[Any, float], list[Any]]) -> Callable[[Any, float], list[Any]]:
    return lambda bus, timeout: read_frames(bus, min(timeout, POLL))


@pytest.fixture(scope="session")
def shared_calibrate(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Calibration]:
    """`simulated_bench.calibrate`, once in a run for each board: the workers of pytest-xdist share the result."""
    from support.calibrations import SharedCalibrations  # noqa: PLC0415  # only where there is posfet_sim

    base = tmp_path_factory.getbasetemp()
    return SharedCalibrations((base.parent if base.name.startswith("popen-") else base) / "calibrations")


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return load_sensor()
