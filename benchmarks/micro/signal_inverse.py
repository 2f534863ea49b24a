"""Counts back to charge: by table, in closed form with ufuncs, and by Newton's method; time and error side by side."""

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
    """The follower's equation solved, in as many ufuncs as it needs."""

    def __init__(self, sensor: Sensor, taxels: int, kind: type) -> None:
        lsb = adc.lsb(SCALE_BITS, sensor.adc.low, sensor.adc.high)
        capacitance, gain = sensor.device.film_capacitance, sensor.amplifier.follower_gain
        self._scale = kind(lsb * capacitance / gain)
        self._shift = kind((sensor.adc.low / gain - sensor.amplifier.offset) * capacitance)
        self._out = np.zeros(taxels, kind)

    def __call__(self, counts: NDArray[np.uint16]) -> NDArray[np.floating]:
        """Return the charge density [C/m2]."""
        np.multiply(counts, self._scale, out=self._out)
        self._out += self._shift
        return self._out


class Newton:
    """The follower's loop ``v = A*(u + offset - v)`` solved for the input u step by step, as a curve would be."""

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
    """Compare on counts of the whole range; the reference is the table's own formula at 80 bits."""
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
        ways = {
            "table": partial(table.charge, counts, out),
            "closed form, float64": partial(ClosedForm(sensor, size * size, np.float64), counts),
            "closed form, float32": partial(ClosedForm(sensor, size * size, np.float32), counts),
            "Newton": partial(Newton(sensor, size * size), counts),
        }
        exact = exact_all[counts]
        for name, way in ways.items():
            error = float(np.abs(way() - exact).max()) / per_newton / sensor.device.force_max
            taken = microseconds(way, 60 if full else 15)
            rows.append((name, f"{size} x {size}", taken, error))
            series.setdefault(name, []).append((taken, max(error, 1e-18), f"{size} x {size}"))
    values = {"inverse_table_5x5_us": rows[0][2], "inverse_closed_form_5x5_us": rows[1][2]}
    chart = Chart("front_inverse", "Counts to charge; reference: 80 bits", "run time [us a scan]",
                  "largest error [greatest force]", series)  # fmt: skip
    columns = ("way", "array", "us a scan", "largest error / greatest force")
    note = (
        "The table is as fast as the closed form of this linear follower, and stays so for any curve; it is what runs."
    )
    return Outcome(values, [Table("Inverse of the readout", columns, rows, note)], [chart])
