# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Work of one scan from CAN frames to contacts, counted: lines of Python that are executed, and calls into C.

The same code has the same count on every machine, however busy it is. What a single array operation costs is not
counted; `make bench` measures times.

`cd test && python -m support.scan_cost --store` stores the result as the baseline (test/data/speed/scan_cost.json).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

import numpy as np

from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain
from support.paths import ROOT

BASELINE: Final = ROOT / "test" / "data" / "speed" / "scan_cost.json"
SENSOR: Final = load_sensor()
REST, TOUCH, WARM = 800, 400, 200
CASES: Final = {"idle": False, "touched": True}


def frames_of(touched: bool) -> list[list[Frame]]:
    """Return the frames of each scan: rest, then two held fingertips if `touched`, else rest throughout."""
    chain, codec = ForwardSignalChain(SENSOR, np.random.default_rng(3)), make_codec(SENSOR)
    force = np.zeros((5, 5))
    force[1:3, 0:2], force[3:5, 3:5] = 0.3, 0.2
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    frames = []
    for index in range(REST + TOUCH):
        chain.advance(force.ravel() * min(max(index - REST, 0) / 20, 1.0) * touched, 25.0, 1e-3)
        chain.counts(scan.counts)
        scan.sequence, scan.device_time = index, index * 1000
        frames.append(codec.encode(scan, SENSOR.can.base_id))
    return frames


def player(touched: bool) -> Callable[[int], int]:
    """Return a function that processes the scan of an index, touched from scan `REST` on, and returns their number."""
    decoder, model = Decoder(SENSOR), Reconstructor(SENSOR)
    decoder.start()
    decoder.scan.temperatures[:] = 25.0
    frames = frames_of(touched)

    def take(index: int) -> int:
        scans = 0
        for decoded in decoder.decode(frames[index], index * 1_000_000, 0):
            if isinstance(decoded, ScanReady):
                scans += model.process(decoded.scan).accepted
        return scans

    return take


class Steps:
    """Counts what a thread executes."""

    def __init__(self) -> None:
        self.number = 0
        """Lines and calls into C."""

    @contextmanager
    def counting(self) -> Iterator[None]:
        """Count, in place of a debugger or profiler."""
        before = sys.gettrace(), sys.getprofile()
        sys.setprofile(self._called)
        sys.settrace(self._stepped)
        try:
            yield
        finally:
            sys.settrace(before[0])
            sys.setprofile(before[1])

    def _stepped(self, frame: FrameType, event: str, argument: Any) -> Any:
        self.number += event == "line"
        return self._stepped

    def _called(self, frame: FrameType, event: str, argument: Any) -> None:
        self.number += event == "c_call"


def costs() -> dict[str, float]:
    """Return the number of steps of a scan, on average, in each case."""
    return {name: cost(player(touched)) for name, touched in CASES.items()}


def cost(take: Callable[[int], int]) -> float:
    """Return the number of steps of a scan, on average over the last ones of a player."""
    steps = Steps()
    for index in range(REST + WARM):
        take(index)
    with steps.counting():
        for index in range(REST + WARM, REST + TOUCH):
            take(index)
    return steps.number / (TOUCH - WARM)


if __name__ == "__main__":
    found = {name: round(steps) for name, steps in costs().items()}
    print(json.dumps(found))
    if "--store" in sys.argv:
        BASELINE.parent.mkdir(parents=True, exist_ok=True)
        BASELINE.write_text(json.dumps(found) + "\n", encoding="ascii")
