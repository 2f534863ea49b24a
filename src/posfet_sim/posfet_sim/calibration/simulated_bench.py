# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated calibration rig: presses each taxel, cools and warms, holds one for long, and fits the calibration."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Final

import numpy as np

from posfet_model.calibration.bench_signals import TAIL, Recording
from posfet_model.calibration.least_squares_fit import fit
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_sim.calibration.bench_recording import interpolated_temperature
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import Keyframes, Scene, SceneObject

REST: Final = 1.0
"""Time before the first press [s]."""

PRESS: Final = (0.8, 2.9)
"""Time per taxel: at least so many seconds, and so many leakage time constants, as shorter presses do not tell them."""

RELATIVE_FORCE: Final = 0.4
"""Force of a press relative to the full-scale force of a taxel [1]."""

COOLING: Final = 3.0
"""Range of the temperature after the presses [K], which charges the film as a press does: half of it is below and half
above the temperature of the presses, so that leakage that changes with temperature does not count as pyroelectric gain.
"""

COOLING_TIME: Final = 8.0
"""Duration of the temperature's way down, up and back [s]."""

PAUSE: Final = (2.0, TAIL)
"""Rest before and after the change of temperature: at least so many seconds, and so many leakage time constants."""

LIGHT_FORCE: Final = 0.05
"""Force of a light touch before the long hold, relative to the full-scale force [1]: the temperature rise of a
touched taxel hardly depends on the force, while relaxation is in proportion to it."""

LIGHT_TIME: Final = 3.0
"""Duration of the light touch, and of the rest after it [s]."""

HOLD: Final = 40.0
"""Duration of the long hold [s]: four times the slowest relaxation pole."""

AFTER_HOLD: Final = 15.0
"""Duration of the rest after the long hold [s]."""


def pressing_scene(sensor: Sensor, long_hold: bool = True) -> Scene:
    """Return a scene in which a small ball presses each taxel in turn, the chip cools and warms, and the ball holds.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    long_hold : bool, default True
        Whether there are a light touch and a long hold at the end.

    Returns
    -------
    Scene
        The scene; it plays once.
    """
    force, tau = RELATIVE_FORCE * sensor.device.force_max, sensor.device.leak_time_constant
    press, pause = (max(seconds, constants * tau) for seconds, constants in (PRESS, PAUSE))
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for index, (x, y) in enumerate(sensor.layout.positions.tolist()):
        begin = REST + index * press
        for fraction, load in ((0.05, 0.0), (0.2, force), (0.6, force), (0.75, 0.0)):
            times.append(begin + fraction * press)
            values.append((x, y, 0.0, load))
    end = REST + sensor.layout.taxels * press
    cool = end + pause
    period = cool + COOLING_TIME + pause
    if long_hold:
        x, y = sensor.layout.positions[_middle(sensor)].tolist()
        light = LIGHT_FORCE * sensor.device.force_max
        for begin, duration, load in ((period, LIGHT_TIME, light), (period + 2 * LIGHT_TIME, HOLD, force)):
            for time, value in ((0.0, 0.0), (0.2, load), (duration - 0.2, load), (duration, 0.0)):
                times.append(begin + time)
                values.append((x, y, 0.0, value))
        period += 2 * LIGHT_TIME + HOLD + AFTER_HOLD
    return Scene(
        name="calibration",
        description="a ball presses each taxel in turn, then the chip cools and warms, and the ball holds",
        period=period,
        objects=(SceneObject("ball", Sphere(2e-3, 4e6), Keyframes(tuple(times), tuple(values))),),
        temperature=Keyframes(
            tuple(cool + part * COOLING_TIME for part in (0.0, 0.25, 0.75, 1.0)),
            ((25.0,), (25.0 - COOLING / 2,), (25.0 + COOLING / 2,), (25.0,)),
        ),
    )


def _middle(sensor: Sensor) -> int:
    """Return the taxel next to the middle of the array."""
    return int(np.argmin(np.abs(sensor.layout.positions).sum(axis=1)))


def record(
    sensor: Sensor,
    seed: int,
    error_model: ErrorModel | None,
    device: Sensor | None = None,
    long_hold: bool = True,
) -> Recording:
    """Record the calibration scene on a simulated board.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    seed : int
        Seed of the board.
    error_model : ErrorModel or None
        Error model of the board; None: ideal.
    device : Sensor, optional
        True properties of the board; default: as in `sensor`.
    long_hold : bool, default True
        Whether there are a light touch and a long hold at the end, which tell relaxation and warmth.

    Returns
    -------
    Recording
        Scans of the board, with the true forces as the reference.
    """
    scene = pressing_scene(sensor, long_hold)
    times, counts, temperatures, forces = [], [], [], []
    for scan, truth in received_scans(device or sensor, scene, scene.period, seed, error_model):
        times.append(truth.time)
        counts.append(scan.counts.copy())
        temperatures.append(scan.temperatures.copy())
        forces.append(truth.force)
    time = np.array(times)
    return Recording(
        time=time,
        counts=np.array(counts),
        temperature=interpolated_temperature(time, np.array(temperatures, np.float64).mean(axis=1)),
        force=np.array(forces),
    )


def calibrate(
    sensor: Sensor,
    seed: int,
    error_model: ErrorModel | None = None,
    device: Sensor | None = None,
    long_hold: bool = True,
) -> Calibration:
    """Calibrate a simulated board.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    seed : int
        Seed of the board.
    error_model : ErrorModel, optional
        Error model of the board; default: ideal.
    device : Sensor, optional
        True properties of the board; default: as in `sensor`.
    long_hold : bool, default True
        Whether there are a light touch and a long hold at the end, which tell relaxation and warmth.

    Returns
    -------
    Calibration
        Result of the fit.

    Raises
    ------
    ValueError
        The fit fails.
    """
    return fit(sensor, record(sensor, seed, error_model, device, long_hold), timestamp())


def timestamp() -> str:
    """Return the current UTC time in ISO 8601 format, in seconds."""
    return datetime.now(timezone.utc).isoformat("T", "seconds")
