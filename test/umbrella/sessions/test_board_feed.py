# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The ground truth of an emulated board is kept until its scans are read."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from posfet.sessions import board_feed
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel

SENSOR = load_sensor()


class Peer:
    """Takes the place of the simulated board: the test calls `on_scan`."""

    on_scan: Callable[[Scan, int], None]

    def __init__(self, *_: object, **__: object) -> None:
        self.board = SimpleNamespace(truth=lambda: None)

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def test_when_too_many_are_unread_only_the_oldest_ground_truths_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Peer] = []

    def make(*arguments: Any, **named: Any) -> Peer:
        made.append(Peer(*arguments, **named))
        return made[-1]

    monkeypatch.setattr(board_feed, "SimulatedBusPeer", make)
    monkeypatch.setattr(board_feed, "ground_truth", lambda truth, sequence, layout: sequence)
    monkeypatch.setattr(board_feed, "KEPT_TRUTHS", 4)
    feed = board_feed.emulated_feed(SENSOR, "idle", 0, ErrorModel.none(), 1.0)
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    for scan.sequence in range(6):
        made[0].on_scan(scan, 0)
    feed.close()
    assert [feed._truth_of(sequence) for sequence in range(6)] == [None, None, 2, 3, 4, 5]
