# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Cost of a scan, from frames to contacts, in units of a fixed workload measured alternately.

`cd test && python -m support.scan_cost --store` stores the result as the baseline (test/data/speed/scan_cost.json).
"""

from __future__ import annotations

import gc
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
import numpy as np

from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.decoder import Decoder, ScanReady
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain

BASELINE = ROOT / "test" / "data" / "speed" / "scan_cost.json"
SENSOR = load_sensor()
REST, TOUCH, WARM = 800, 800, 200
BATCH = 20
"""Number of scans timed together: one block of the observer, so that every batch contains one block end."""
CASES = {"idle": False, "touched": True}


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


def fixed_work() -> float:
    """Run a fixed workload similar to a scan, small array operations and plain Python: the unit of cost."""
    one, other, total = np.full(25, 0.5), np.zeros(25), 0.0
    for number in range(20):
        np.multiply(one, 1.01, out=other)
        np.add(one, other, out=other)
        total += float(other.sum())
        pairs = [(index, index * total) for index in range(10)]
        total += max(pairs)[1] * 1e-9 + math.sqrt(number)
    return total


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


def costs() -> dict[str, float]:
    """Return the cost of a scan in units of `fixed_work`, both the minimum of many alternating runs."""
    takes = {name: player(touched) for name, touched in CASES.items()}
    for take in takes.values():
        for index in range(REST + WARM):
            take(index)
    least = dict.fromkeys((*CASES, "unit"), math.inf)
    gc.disable()
    try:
        for first in range(REST + WARM, REST + TOUCH, BATCH):
            for name, take in takes.items():
                begin = time.perf_counter_ns()
                for index in range(first, first + BATCH):
                    take(index)
                least[name] = min(least[name], (time.perf_counter_ns() - begin) / BATCH)
            for _ in range(BATCH):
                begin = time.perf_counter_ns()
                fixed_work()
                least["unit"] = min(least["unit"], time.perf_counter_ns() - begin)
    finally:
        gc.enable()
    return {name: least[name] / least["unit"] for name in CASES}


if __name__ == "__main__":
    found = [costs() for _ in range(5)]
    middle = {name: round(sorted(each[name] for each in found)[2], 3) for name in CASES}
    print(json.dumps(middle))
    if "--store" in sys.argv:
        BASELINE.parent.mkdir(parents=True, exist_ok=True)
        BASELINE.write_text(json.dumps(middle) + "\n", encoding="ascii")
