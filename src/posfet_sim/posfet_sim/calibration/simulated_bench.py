"""The simulated calibration rig: presses each taxel once and fits the calibration."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Final

import numpy as np

from posfet_model.calibration.least_squares_fit import Recording, fit
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_sim.calibration.bench_recording import interpolated_temperature
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import Keyframes, Scene, SceneObject

REST: Final = 1.0
"""Time before the first press [s]."""

PRESS: Final = 0.8
"""Time per taxel [s]."""

RELATIVE_FORCE: Final = 0.4
"""Force of a press relative to the full-scale force of a taxel [1]."""

COOLING: Final = 3.0
"""Temperature drop after the presses [K], which charges the film as a press does."""

COOLING_TIME: Final = 4.0
"""Duration of the temperature drop [s]."""


def pressing_scene(sensor: Sensor) -> Scene:
    """Return a scene in which a small ball presses each taxel in turn, and then the chip cools."""
    force = RELATIVE_FORCE * sensor.device.force_max
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for index, (x, y) in enumerate(sensor.layout.positions.tolist()):
        begin = REST + index * PRESS
        for fraction, load in ((0.05, 0.0), (0.2, force), (0.6, force), (0.75, 0.0)):
            times.append(begin + fraction * PRESS)
            values.append((x, y, 0.0, load))
    end = REST + sensor.layout.taxels * PRESS
    return Scene(
        name="calibration",
        description="a ball presses each taxel in turn, then the chip cools",
        period=end + 2 * COOLING_TIME,
        objects=(SceneObject("ball", Sphere(2e-3, 4e6), Keyframes(tuple(times), tuple(values))),),
        temperature=Keyframes((end, end + COOLING_TIME), ((25.0,), (25.0 - COOLING,))),
    )


def record(sensor: Sensor, seed: int, error_model: ErrorModel | None, device: Sensor | None = None) -> Recording:
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

    Returns
    -------
    Recording
        Scans of the board, with the true forces as the reference.
    """
    scene = pressing_scene(sensor)
    times, counts, temperatures, forces = [], [], [], []
    for scan, truth in received_scans(device or sensor, scene, scene.period, seed, error_model):
        times.append(truth.time)
        counts.append(scan.counts.copy())
        temperatures.append(float(np.mean(scan.temperatures)))
        forces.append(truth.force)
    time = np.array(times)
    return Recording(
        time=time,
        counts=np.array(counts),
        temperature=interpolated_temperature(time, np.array(temperatures)),
        force=np.array(forces),
    )


def calibrate(
    sensor: Sensor, seed: int, error_model: ErrorModel | None = None, device: Sensor | None = None
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

    Returns
    -------
    Calibration
        Result of the fit.

    Raises
    ------
    ValueError
        The fit fails.
    """
    return fit(sensor, record(sensor, seed, error_model, device), timestamp())


def timestamp() -> str:
    """Return the current UTC time in ISO 8601 format, in seconds."""
    return datetime.now(timezone.utc).isoformat("T", "seconds")
