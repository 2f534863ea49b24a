# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Inverse of the read-out: counts to charge, by table, closed form and Newton's method."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.fronts.front import Check, Effort, Front
from benchmarks.fronts.interleaved import timed
from posfet_model.device import adc
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT
from posfet_model.sensor.signal_chain import SCALE_BITS, InverseSignalChain

FLOAT64 = 4.5e-16
"""Two roundings of a result of full scale [1]."""


class ClosedForm:
    """Closed-form solution of the follower equation by ufuncs."""

    def __init__(self, sensor: Sensor, dtype: type) -> None:
        lsb = adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)
        capacitance, gain = sensor.device.film_capacitance, sensor.amplifier.follower_gain
        self._scale = dtype(lsb * capacitance / gain)
        self._shift = dtype((sensor.adc.low / gain - sensor.amplifier.offset) * capacitance)
        self._out = np.zeros(sensor.layout.taxels, dtype)

    def __call__(self, counts: NDArray[np.uint16]) -> NDArray[np.floating]:
        """Return the charge density [C/m2]."""
        np.multiply(counts, self._scale, out=self._out)
        self._out += self._shift
        return self._out


class Newton:
    """The follower's loop ``v = A*(u + offset - v)`` solved for the input u by iteration, from the output."""

    def __init__(self, sensor: Sensor, steps: int) -> None:
        self._sensor, self._steps = sensor, steps
        self._lsb = adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)

    def __call__(self, counts: NDArray[np.uint16]) -> NDArray[np.floating]:
        """Return the charge density [C/m2]."""
        amplifier = self._sensor.amplifier
        volts = counts * self._lsb + self._sensor.adc.low
        shift = volts.copy()
        for _ in range(self._steps):
            shift -= (amplifier.follower_gain * (shift + amplifier.offset) - volts) / amplifier.follower_gain
        return shift * self._sensor.device.film_capacitance


def measure(effort: Effort) -> list[Front]:
    """Compare on counts of the whole range; the reference is the formula in 80-bit floating point."""
    sensor = load_sensor()
    counts = np.random.default_rng(1).integers(0, FULL_SCALE_COUNT + 1, sensor.layout.taxels).astype(np.uint16)
    low, high = np.longdouble(sensor.adc.low), np.longdouble(sensor.adc.high)
    exact = (low + counts.astype(np.longdouble) * (high - low) / FULL_SCALE_COUNT) / np.longdouble(
        sensor.amplifier.follower_gain
    )
    exact = (exact - np.longdouble(sensor.amplifier.offset)) * np.longdouble(sensor.device.film_capacitance)
    table, out = InverseSignalChain(sensor), np.zeros(sensor.layout.taxels)
    methods = {
        ("table", ""): partial(table.charge, counts, out),
        ("closed form", "float64"): partial(ClosedForm(sensor, np.float64), counts),
        ("closed form", "float32"): partial(ClosedForm(sensor, np.float32), counts),
        **{("Newton", f"{steps} steps"): partial(Newton(sensor, steps), counts) for steps in (0, 1, 2)},
    }
    scale = float(np.abs(exact).max())
    errors = {key: float(np.abs(method() - exact).max()) / scale for key, method in methods.items()}
    choices = timed({key: (method, errors[key]) for key, method in methods.items()}, effort.repeats)
    lost = 1 - sensor.amplifier.follower_gain
    checks = (
        Check("error of the table [full scale]", errors["table", ""], 0.0, FLOAT64),
        Check("error of the closed form in float32 over half a unit in the last place [1]",
              errors["closed form", "float32"] / 2**-24, 0.1, 4.0),
        Check("error without Newton's method over the gain that the loop loses [1]",
              errors["Newton", "0 steps"] / lost, 0.9, 1.1),
    )  # fmt: skip
    return [
        Front(
            "inverse",
            "Inverse of the read-out",
            "one scan of 25 taxels",
            "largest error [full scale]",
            "the same formula in 80-bit floating point",
            FLOAT64,
            choices,
            "table",
            checks,
            "A table of all counts is exact to rounding and works for any curve, with charge and saturation in one "
            "look-up. Choose a closed form only where the memory of the table is missing, and no iteration for a curve "
            "that is known before the first scan.",
            why_not="The table also gives the saturation, which the others leave out.",
            question="the charge from a count",
            rival="Newton, 2 steps",
        )
    ]
