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

from posfet_model.device import adc
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import SCALE_BITS, charge_per_newton, leakage_step

Forces: TypeAlias = "NDArray[np.floating[Any]]"
START = 1_700_000_000_000_000_000
CHUNK = 50
"""Scans that are computed at once."""


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
    scan = Scan.empty(layout.id, layout.taxels)
    conversions = _Conversions(device, np.random.default_rng(seed), rate)
    times = [index / rate for index in range(round(duration * rate))]
    for begin in range(0, len(times), CHUNK):
        part = times[begin : begin + CHUNK]
        temperatures = [temperature(time) for time in part]
        counts = conversions.next(np.multiply.outer([force(time) for time in part], shape), np.array(temperatures))
        for index, time in enumerate(part):
            scan.counts[:] = counts[index]
            scan.stamp = START + round(time * 1e9)
            scan.sequence = begin + index
            scan.device_time = round(time * 1e6)
            scan.temperatures[:] = temperatures[index]
            scan.status = 0
            yield time, scan


class _Conversions:
    """The counts of a `ForwardSignalChain`, bit for bit, for many scans at once: a fifth of the time."""

    def __init__(self, device: Sensor, rng: np.random.Generator, rate: float) -> None:
        self._device, self._rng = device, rng
        self._leak = leakage_step(1 / rate, device.device.leak_time_constant)
        self._charge, self._source = np.zeros(device.layout.taxels), np.zeros(device.layout.taxels)
        self._reference: float | None = None

    def next(self, force: Forces, temperature: Forces) -> NDArray[np.uint16]:
        """Return the counts for forces [N] and film temperatures [degC] of consecutive scans."""
        device = self._device
        if self._reference is None:
            self._reference = float(temperature[0])
        source = force * charge_per_newton(device)
        source += (device.device.pyroelectric_coefficient * (temperature - self._reference))[:, None]
        added = np.diff(source, axis=0, prepend=self._source[None]) * self._leak.mean
        self._source = source[-1]
        for row in added:
            self._charge *= self._leak.decay
            self._charge += row
            row[:] = self._charge
        return self._converted(added)

    def _converted(self, charge: Forces) -> NDArray[np.uint16]:
        amplifier, converter = self._device.amplifier, self._device.adc
        volts = (charge / self._device.device.film_capacitance + amplifier.offset) * amplifier.follower_gain
        codes = np.clip(volts, amplifier.rail_low, amplifier.rail_high)
        if converter.noise > 0:
            codes += self._rng.standard_normal(codes.shape) * converter.noise
        codes = np.rint((codes - converter.low) / adc.lsb(converter.bits, converter.low, converter.high))
        counts = np.clip(codes, 0, (1 << converter.bits) - 1).astype(np.uint16)
        missing = SCALE_BITS - converter.bits
        return counts << missing | counts >> (converter.bits - missing) if missing else counts
