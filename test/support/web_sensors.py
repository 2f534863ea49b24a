# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sensors for tests of the browser view, without ROS: they show what the test says, and note what is asked of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from posfet.array_view import ArrayView
from posfet.diagnosis import Diagnosis
from posfet.snapshot import ContactView, Snapshot, TrueContact
from posfet.web.viewed import Viewed
from posfet_model.config import ConfigError

TOKEN = "t" * 43
ARRAY = ArrayView("small", "S-1", True, 2, 3, (1.5e-3, 1.5e-3), math.inf, "x", 5.0, 0.02, 1000.0)
TOUCH = ContactView(7, "moving", 1e-3, -0.5e-3, 1.25, 0.004, 9e-6, 2.5, (0.6e-3, 0.0), (0.0, 0.5e-3), (0.02, 0.0))
SNAPSHOT = Snapshot(
    time=10.0,
    scans=1000,
    frames_lost=3,
    scans_lost=2,
    rows=2,
    cols=3,
    force=np.array([0.0, 0.125, 1.15, -0.0, math.nan, 0.03125], np.float32),
    total_force=1.25,
    data_valid=True,
    contacts=(TOUCH,),
    truth=(TrueContact(1.03e-3, -0.46e-3, 1.25),),
    state="simulated board runs",
    calibration="uncalibrated: forces may be off by 10%",
    standard_deviation=np.array([0.01, 0.02, 0.03, 0.01, math.nan, math.nan], np.float32),
    status=np.array([0, 0, 3, 0, 1, 0], np.uint8),
    total_standard_deviation=0.016,
    sequence=4711,
    stamp=1_700_000_000_123_000_000,
)
"""One contact; a saturated taxel with a force, a dead one, one without a standard deviation."""


class FakeRecordings:
    """Recordings that fail when the test says so."""

    def __init__(self) -> None:
        self.running = False

    def start(self) -> str:
        if self.running:
            raise ConfigError("is being recorded already")
        self.running = True
        return "recording to thumb.mcap"

    def stop(self) -> str:
        self.running = False
        return "thumb.mcap: 2.0 s, 40 messages"


@dataclass
class FakeSensor:
    """Client and source of snapshots."""

    namespace: str = "tactile"
    array: ArrayView | None = ARRAY
    shown: Snapshot | None = SNAPSHOT
    diagnoses: dict[str, Diagnosis] = field(default_factory=dict)
    served: tuple[str, ...] = ("tare", "scene/load")
    requests: list[tuple[str, str | bool]] = field(default_factory=list)
    recordings: FakeRecordings | None = None
    taken: int = 0
    """Number of snapshots that were taken."""

    def snapshot(self) -> Snapshot | None:
        self.taken += 1
        if self.shown is not None:
            self.shown = replace(self.shown, sequence=self.shown.sequence + 1)
        return self.shown

    def actions(self) -> tuple[str, ...]:
        return self.served

    def request(self, action: str, argument: str | bool, done: Callable[[bool, str], object]) -> None:
        self.requests.append((action, argument))
        done(argument != "nowhere", f"{action} done")

    @property
    def viewed(self) -> Viewed:
        return Viewed(self, self, self.recordings)
