# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Diagnostics of the model node, report by report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.model_diagnostics import ModelDiagnostics
from posfet_model.ros.model_report import ModelReport
from posfet_model.sensor.description import load_sensor
from support.scan_player import scans

pytestmark = pytest.mark.ros

SENSOR = load_sensor()


class FakeNode:
    """A node that publishes into a list, and whose timer is called by the test."""

    def __init__(self) -> None:
        self.published: list[DiagnosticArray] = []
        self.logged: list[str] = []
        self.tick: Callable[[], None] = lambda: None
        self.internal_errors = SimpleNamespace(values=dict)

    def get_namespace(self) -> str:
        return "/tactile"

    def get_fully_qualified_name(self) -> str:
        return "/tactile/model_node"

    def create_publisher(self, *_: Any) -> Any:
        return SimpleNamespace(publish=self.published.append)

    def create_timer(self, _: float, callback: Callable[[], None]) -> None:
        self.tick = callback

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=self.logged.append)

    def report(self) -> DiagnosticStatus:
        self.tick()
        (status,) = self.published[-1].status
        return status


@pytest.mark.parametrize(("rate", "longest"), [(1000.0, 1), (0.5, 4)])
def test_a_board_with_a_scan_every_two_seconds_is_not_one_without_scans(rate: float, longest: int) -> None:
    sensor = replace(SENSOR, can=replace(SENSOR.can, scan_rate=rate))
    node, model, active = FakeNode(), Reconstructor(sensor), [True]
    ModelDiagnostics(
        node,  # type: ignore[arg-type]
        sensor,
        lambda: (active[0], ModelReport(model, model.refresh())),
        SimpleNamespace(dropped=0),  # type: ignore[arg-type]
    )
    levels = []
    for _, scan in scans(SENSOR, 20.0 / rate, force=lambda _: 0.0, rate=rate):
        model.process(scan)
        levels += [node.report().level for _ in range(max(round(1.0 / rate), 1))]
    assert DiagnosticStatus.ERROR not in levels
    silent = [node.report() for _ in range(longest + 1)]
    first = longest - max(round(1.0 / rate), 1)  # reports without a scan that are among those above
    assert [status.level == DiagnosticStatus.ERROR for status in silent].index(True) == first
    assert "no scans" in silent[-1].message
    active[0] = False
    assert node.report().level == DiagnosticStatus.OK
    active[0] = True
    assert (node.report().level == DiagnosticStatus.ERROR) == (longest == 1), "it has not been silent for long"


def test_topics_that_another_node_publishes_too_are_a_warning_logged_once_each_time() -> None:
    node, model, others, active = FakeNode(), Reconstructor(SENSOR), [], [True]
    ModelDiagnostics(
        node,  # type: ignore[arg-type]
        SENSOR,
        lambda: (active[0], ModelReport(model, model.refresh())),
        SimpleNamespace(dropped=0),  # type: ignore[arg-type]
        shared=lambda: others,
    )
    player = scans(SENSOR, 5.0, force=lambda _: 0.0)

    def report() -> DiagnosticStatus:
        for _, (_, scan) in zip(range(200), player, strict=False):
            model.process(scan)
        return node.report()

    assert "another node" not in report().message
    others[:] = ["/tactile/raw", "/tactile/contacts"]
    text = "another node publishes /tactile/raw and /tactile/contacts, too: give each sensor a namespace of its own"
    for _ in range(2):
        status = report()
        assert (status.level, status.message) == (DiagnosticStatus.WARN, text)
    assert node.logged == [f"{text} (a process that was killed counts for 20 s)"]
    assert node.report().message.startswith("no scans: check that the driver is running and active; another node")
    others.clear()
    assert "another node" not in report().message
    others.append("/tactile/contacts")
    report()
    assert len(node.logged) == 2
