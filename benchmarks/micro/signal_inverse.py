# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Conversion of counts to charge by table, closed form and Newton's method: run time and error."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.outcome import Chart, Outcome, Point, Table
from benchmarks.timing import microseconds
from posfet_model.device import adc
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT
from posfet_model.sensor.signal_chain import SCALE_BITS, InverseSignalChain

SIZES = (5, 16, 32, 64)
NEWTON_STEPS = 2


class ClosedForm:
    """Closed-form solution of the follower equation by ufuncs."""

    def __init__(self, sensor: Sensor, taxels: int, dtype: type) -> None:
        lsb = adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)
        capacitance, gain = sensor.device.film_capacitance, sensor.amplifier.follower_gain
        self._scale = dtype(lsb * capacitance / gain)
        self._shift = dtype((sensor.adc.low / gain - sensor.amplifier.offset) * capacitance)
        self._out = np.zeros(taxels, dtype)

    def __call__(self, counts: NDArray[np.uint16]) -> NDArray[np.floating]:
        """Return the charge density [C/m2]."""
        np.multiply(counts, self._scale, out=self._out)
        self._out += self._shift
        return self._out


class Newton:
    """The follower's loop ``v = A*(u + offset - v)`` solved for the input u by iteration."""

    def __init__(self, sensor: Sensor, taxels: int) -> None:
        self._sensor = sensor
        self._lsb = adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)

    def __call__(self, counts: NDArray[np.uint16]) -> NDArray[np.floating]:
        """Return the charge density [C/m2]."""
        amplifier = self._sensor.amplifier
        volts = counts * self._lsb + self._sensor.adc.low
        shift = volts.copy()
        for _ in range(NEWTON_STEPS):
            shift -= (amplifier.follower_gain * (shift + amplifier.offset) - volts) / amplifier.follower_gain
        return shift * self._sensor.device.film_capacitance


def measure(full: bool) -> Outcome:
    """Compare on counts of the whole range; the reference is the formula of the table in 80-bit floating point."""
    sensor = load_sensor()
    rng = np.random.default_rng(1)
    rows = []
    series: dict[str, list[Point]] = {}
    wide = np.arange(FULL_SCALE_COUNT + 1, dtype=np.longdouble)
    low, high = np.longdouble(sensor.adc.low), np.longdouble(sensor.adc.high)
    exact_all = (low + wide * (high - low) / FULL_SCALE_COUNT) / np.longdouble(sensor.amplifier.follower_gain)
    exact_all = (exact_all - np.longdouble(sensor.amplifier.offset)) * np.longdouble(sensor.device.film_capacitance)
    per_newton = abs(sensor.device.piezoelectric_coefficient) / sensor.layout.taxel_area
    table = InverseSignalChain(sensor)
    for size in SIZES:
        counts = rng.integers(0, FULL_SCALE_COUNT + 1, size * size).astype(np.uint16)
        out = np.zeros(size * size)
        methods = {
            "table": partial(table.charge, counts, out),
            "closed form, float64": partial(ClosedForm(sensor, size * size, np.float64), counts),
            "closed form, float32": partial(ClosedForm(sensor, size * size, np.float32), counts),
            "Newton": partial(Newton(sensor, size * size), counts),
        }
        exact = exact_all[counts]
        for name, method in methods.items():
            error = float(np.abs(method() - exact).max()) / per_newton / sensor.device.force_max
            duration = microseconds(method, 60 if full else 15)
            rows.append((name, f"{size} x {size}", duration, error))
            series.setdefault(name, []).append((duration, max(error, 1e-18), f"{size} x {size}"))
    values = {"inverse_table_5x5_us": rows[0][2], "inverse_closed_form_5x5_us": rows[1][2]}
    chart = Chart("front_inverse", "Counts to charge; reference: 80-bit floating point", "run time [us per scan]",
                  "maximum error [full scale]", series)  # fmt: skip
    columns = ("method", "array", "us per scan", "maximum error / full scale")
    note = (
        "The stack uses the table: it is as fast as the closed form of this linear follower, and equally "
        "fast for any curve."
    )
    return Outcome(values, [Table("Inverse of the signal chain", columns, rows, note)], [chart])
