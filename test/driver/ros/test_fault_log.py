# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Faults in the log: one line each when they appear and clear, and none while `log_faults` is false."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.context import Context
from rclpy.parameter import Parameter

from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.ros.scan_source_node import ScanSourceNode

pytestmark = pytest.mark.ros


class FaultyNode(ScanSourceNode):
    """A node around a device that reports the faults that a test puts into `faults`, and keeps what it logs."""

    def __init__(self, **parameters: Any) -> None:
        self.faults: list[FaultKind] = []
        self.logged: list[tuple[str, str]] = []
        self.published: list[list[FaultKind]] = []
        self.test_context = Context()
        rclpy.init(context=self.test_context)
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        super().__init__("faulty_node", context=self.test_context, parameter_overrides=overrides)
        self._diagnostics = SimpleNamespace(publish=lambda _report, _rate, faults: self.published.append(faults))

    def make_source(self, *_: Any) -> Any:
        return SimpleNamespace(report=self._reported_faults, open=lambda: None, close=lambda: None)

    def _reported_faults(self) -> SourceReport:
        return SourceReport(Health.OK, "fine", 0, 0, conditions=tuple(self.faults))

    def get_logger(self) -> Any:
        return SimpleNamespace(
            **{
                level: lambda text, level=level: self.logged.append((level, text))
                for level in ("debug", "info", "warning", "error", "fatal")
            }
        )

    def report(self, *faults: FaultKind) -> list[tuple[str, str]]:
        """Return what is logged when these faults are present."""
        self.faults, self.logged = list(faults), []
        self._report()
        return [line for line in self.logged if line != ("info", "fine")]

    def set(self, value: bool) -> None:
        [result] = self.set_parameters([Parameter("log_faults", value=value)])
        assert result.successful, result.reason


@pytest.fixture
def make_node() -> Iterator[Any]:
    nodes: list[FaultyNode] = []

    def make(**parameters: Any) -> FaultyNode:
        nodes.append(FaultyNode(**parameters))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
        node.test_context.try_shutdown()


WARN = [kind for kind in FaultKind if kind.health == Health.WARN][-1]


def test_a_fault_is_logged_once_when_it_appears_and_once_when_it_clears(make_node: Any) -> None:
    node = make_node()
    assert node.report(FaultKind.NO_SCANS, WARN) == [("error", FaultKind.NO_SCANS.text), ("warning", WARN.text)]
    assert node.report(FaultKind.NO_SCANS, WARN) == []
    assert node.report(WARN) == [("info", f"{FaultKind.NO_SCANS.label}: cleared")]


def test_without_log_faults_they_are_in_the_diagnostics_only(make_node: Any) -> None:
    node = make_node(log_faults=False)
    assert node.report(FaultKind.NO_SCANS) == []
    assert node.published[-1] == [FaultKind.NO_SCANS]
    assert node.report() == []


def test_log_faults_takes_effect_with_the_next_report(make_node: Any) -> None:
    node = make_node()
    node.set(False)
    assert node.report(FaultKind.NO_SCANS) == []
    node.set(True)
    assert node.report(FaultKind.NO_SCANS) == [], "it has not just appeared"
    assert node.report(FaultKind.NO_SCANS, WARN) == [("warning", WARN.text)]
    assert node.report() != []
