# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans of the forward chain for tests of the reconstruction, which may assume another sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain

Forces: TypeAlias = "NDArray[np.floating[Any]]"
START = 1_700_000_000_000_000_000


def nothing(_: float) -> float:
    return 0.0


def press(newton: float, begin: float, end: float, rise: float = 0.02) -> Callable[[float], float]:
    """Return a force over time [s] that rises within `rise` from `begin` and falls within `rise` from `end`."""

    def force(time: float) -> float:
        return newton * min(max((time - begin) / rise, 0.0), 1.0) * min(max((end + rise - time) / rise, 0.0), 1.0)

    return force


def scans(
    device: Sensor,
    duration: float,
    force: Callable[[float], float] = nothing,
    shape: Forces | None = None,
    temperature: Callable[[float], float] = lambda _: 25.0,
    seed: int = 0,
    rate: float = 1000.0,
) -> Iterator[tuple[float, Scan]]:
    """Yield time [s] and scan; all scans are the same object.

    `shape` is the force on each taxel for a force of 1 N; without it the centre taxel carries all of it. Film and chip
    have the same temperature.
    """
    layout = device.layout
    if shape is None:
        shape = np.eye(1, layout.taxels, layout.taxels // 2)[0]
    chain = ForwardSignalChain(device, np.random.default_rng(seed))
    scan = Scan.empty(layout.id, layout.taxels)
    for index in range(round(duration * rate)):
        time = index / rate
        chain.advance(shape * force(time), temperature(time), 1 / rate)
        chain.counts(scan.counts)
        scan.stamp = START + round(time * 1e9)
        scan.sequence = index
        scan.device_time = round(time * 1e6)
        scan.temperatures[:] = temperature(time)
        scan.status = 0
        yield time, scan
