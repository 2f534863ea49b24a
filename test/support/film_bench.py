# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A calibration rig with a film that relaxes, creeps and warms, integrated apart from the model that the fit uses.

Dielectric relaxation is a spread of many time constants, creep a second one; the fit has three. The forces are those of
the simulated rig.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_model.calibration.bench_signals import Recording
from posfet_model.sensor.description import Layout, Sensor, load_sensor
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.calibration.simulated_bench import pressing_scene
from posfet_sim.scene import Scene, SceneLoads

RATE = 250.0
"""Scans per second [Hz]."""
RELAXATION_TIMES = np.geomspace(3e-3, 30.0, 17)
"""Time constants of the dielectric relaxation [s]: four per decade."""
CREEP_TIMES = np.array([1.0, 1.8, 3.2, 5.6, 10.0])
"""Time constants of the creep [s]."""
Floats: TypeAlias = "NDArray[np.float64]"
Alteration: TypeAlias = "Callable[[Floats, Floats], Floats]"
"""Alters a signal, given with its times [s]."""


@dataclass(frozen=True)
class Film:
    """What a film does that an ideal one does not."""

    relaxation: float = 0.0
    """Charge that comes in slowly, per decade of time [1]."""
    creep: float = 0.0
    """Charge that comes in from 1 to 10 s [1]."""
    warmth: float = 0.0
    """Temperature rise of a touched taxel [K]."""
    warmth_time: float = 0.5
    """Its time constant [s]."""
    warmth_force: float = 0.02
    """Force that causes half of it [N]."""
    warmth_power: float = 1.0
    """Power of the force with which it rises, as F^n/(F^n + half^n) [1]: a large one is a step."""
    sensor_lag: float = 0.0
    """Lag of the temperature sensors behind the chip [s]."""
    nonlinearity: float = 0.0
    """Loss of sensitivity per force [1/N]."""
    hysteresis: float = 0.0
    """Width of the hysteresis loops of large forces [N]."""
    plays: tuple[float, ...] = (0.04, 0.1, 0.2, 0.4)
    """Half widths of the play operators of the hysteresis [N]."""
    ramp: float = 0.0
    """Slope of the chip's temperature [K/s]."""
    bending: float = 0.0
    """Charge on every taxel per total force [1]."""
    bending_moment: float = 0.0
    """The same per moment of the forces, at the edges of the array and relative to half a side [1]."""


@dataclass(frozen=True, eq=False)
class Board:
    """A board with random gains, leakage and offsets, and a recording of it."""

    recording: Recording
    gain: Floats
    """Signal per force at once, relative to nominal [1], shape [taxels]."""
    leak_time_constant: Floats
    """[s], shape [taxels]."""


@lru_cache(maxsize=4)
def _programme(layout: Layout, long_hold: bool) -> tuple[Floats, Floats, Floats]:
    sensor = replace(load_sensor(), layout=layout)
    return forces_of(sensor, pressing_scene(sensor, long_hold))


def forces_of(sensor: Sensor, scene: Scene) -> tuple[Floats, Floats, Floats]:
    """Return times [s], forces [N] and chip temperature [degC] of a scene."""
    time = np.arange(0.0, scene.period, 1.0 / RATE)
    loads = SceneLoads(scene, sensor)
    force = np.zeros((len(time), sensor.layout.rows, sensor.layout.cols))
    for begin in range(0, len(time), 256):
        part = force[begin : begin + 256]
        for patch in loads.forces(time[begin : begin + 256].tolist()):
            part[:, patch.rows, patch.cols] += patch.force
    return time, force.reshape(len(time), -1), np.array(list(loads.temperatures(time.tolist())))


def lag(time: Floats, values: Floats, tau: float) -> Floats:
    """Return a first-order lag behind values by the trapezoidal rule, from rest at the first value."""
    if tau == 0:
        return values.copy()
    half = 0.5 * float(time[1] - time[0]) / tau
    change = half / (1.0 + half) * (values[1:] + values[:-1] - 2.0 * values[0])
    return values[0] + _accumulated((1.0 - half) / (1.0 + half), change)


def _accumulated(kept: Floats | float, change: Floats) -> Floats:
    """Return the states x of x[k + 1] = kept*x[k] + change[k], from x[0] = 0."""
    states = np.zeros((len(change) + 1, *change.shape[1:]))
    for step, added in enumerate(change):
        states[step + 1] = kept * states[step] + added
    return states


def with_hysteresis(force: Floats, film: Film) -> Floats:
    """Return the force and what play operators of it add [N], each of which follows it at its half width."""
    result = force.copy()
    if film.hysteresis:
        widths = np.array(film.plays)[:, None]
        plays = np.zeros((len(film.plays), force.shape[1]))
        for index, now in enumerate(force):
            np.maximum(plays, now - widths, out=plays)
            np.minimum(plays, now + widths, out=plays)
            result[index] += 0.5 * film.hysteresis / sum(film.plays) * plays.sum(axis=0)
    return result


def with_slow_charge(time: Floats, force: Floats, film: Film) -> Floats:
    """Return the force whose charge an ideal film would give at once, shape [scans, taxels]."""
    source = force * (1.0 - film.nonlinearity * force)
    share = film.relaxation * np.log10(RELAXATION_TIMES[1] / RELAXATION_TIMES[0])
    times = np.concatenate([np.maximum(RELAXATION_TIMES, 0.6 / RATE), CREEP_TIMES])
    sizes = np.concatenate([np.full(len(RELAXATION_TIMES), share), np.full(len(CREEP_TIMES), film.creep / 5.0)])
    if not sizes.any():
        return source
    half = 0.5 * float(time[1] - time[0]) / times[:, None]
    state = np.repeat(source[:1], len(times), axis=0)
    total = source.copy()
    total[0] += sizes @ state
    for index in range(1, len(source)):
        state = (state * (1.0 - half) + half * (source[index] + source[index - 1])) / (1.0 + half)
        total[index] += sizes @ state
    return total


def gain_at_once(film: Film) -> float:
    """Return the signal per force after 30 ms, relative to that of an ideal film [1]: a press is no faster."""
    per_time = film.relaxation * np.log10(RELAXATION_TIMES[1] / RELAXATION_TIMES[0])
    return 1.0 + float(per_time * np.sum(RELAXATION_TIMES < 0.03))


def record(
    sensor: Sensor,
    film: Film,
    seed: int = 1,
    long_hold: bool = True,
    change: Alteration | None = None,
    sensors: Alteration | None = None,
) -> Board:
    """Return a board and what the rig records of it.

    `change` alters the film's signal [N], `sensors` the reading of the chip's sensors [degC], with time [s].
    """
    rng = np.random.default_rng(seed)
    taxels = sensor.layout.taxels
    time, force, chip = _programme(sensor.layout, long_hold)
    chip = chip + film.ramp * time
    gain = 1.0 + 0.06 * rng.standard_normal(taxels)
    tau = sensor.device.leak_time_constant * np.exp(0.1 * rng.standard_normal(taxels))
    per_kelvin = sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)
    temperature = lag(time, chip, sensor.device.thermal_time_constant)[:, None] - chip[0]
    if film.warmth:
        pressed = force**film.warmth_power
        touched = pressed / (pressed + film.warmth_force**film.warmth_power)
        temperature = temperature + lag(time, film.warmth * touched, film.warmth_time)
    places = sensor.layout.positions - sensor.layout.positions.mean(axis=0)
    places = places / np.abs(places).max(axis=0)
    bent = film.bending * force.sum(axis=1, keepdims=True) + film.bending_moment * (force @ places) @ places.T
    source = gain * (with_slow_charge(time, with_hysteresis(force, film), film) + bent) + per_kelvin * temperature
    if change is not None:
        source = change(time, source)
    half = 0.5 / RATE / tau
    charge = _accumulated((1.0 - half) / (1.0 + half), np.diff(source, axis=0) / (1.0 + half))
    volts = charge * sensor.volts_per_newton + 5e-3 * rng.standard_normal(taxels)
    volts += np.cumsum(rng.standard_normal(volts.shape), axis=0) * 1e-6 / np.sqrt(RATE)
    volts += sensor.adc.noise * rng.standard_normal(volts.shape)
    counts = (volts - sensor.adc.low) / (sensor.adc.high - sensor.adc.low) * 65535
    reading = lag(time, chip, film.sensor_lag)
    slow = time[:: int(RATE / 10)]
    reported = np.round((reading[:: int(RATE / 10)] + 2e-3 * rng.standard_normal(len(slow))) * 256) / 256
    if sensors is not None:
        reported = sensors(slow, reported)
    recording = Recording(time, np.round(counts).astype(np.uint16), np.interp(time, slow, reported), force)
    return Board(recording, gain, tau)
