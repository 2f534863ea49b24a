"""The simulated test stand: every taxel pressed once, and the calibration that comes of it."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Final

import numpy as np

from posfet_model.calibration.least_squares_fit import Recording, fit
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_sim.calibration.bench_recording import even_temperature
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.imperfections import Imperfections
from posfet_sim.emulation.offline import wire_scans
from posfet_sim.scene import Scene, SceneObject, Track

REST: Final = 1.0
"""At rest before the first press [s]."""


PRESS: Final = 0.8
"""Time for one taxel [s]."""


SHARE: Final = 0.4
"""Force of a press, in the greatest force of a taxel [1]."""


COOLING: Final = 3.0
"""Fall of temperature after the presses [K]: it charges the film as a press does."""


COOLING_TIME: Final = 4.0
"""[s]"""


def pressing_scene(sensor: Sensor) -> Scene:
    """Return a scene in which a small ball presses each taxel in turn, before the chip cools."""
    force = SHARE * sensor.device.force_max
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for index, (x, y) in enumerate(sensor.layout.positions.tolist()):
        begin = REST + index * PRESS
        for share, load in ((0.05, 0.0), (0.2, force), (0.6, force), (0.75, 0.0)):
            times.append(begin + share * PRESS)
            values.append((x, y, 0.0, load))
    end = REST + sensor.layout.taxels * PRESS
    return Scene(
        name="calibration",
        description="a ball presses each taxel in turn, then the chip cools",
        period=end + 2 * COOLING_TIME,
        objects=(SceneObject("ball", Sphere(2e-3, 4e6), Track(tuple(times), tuple(values))),),
        temperature=Track((end, end + COOLING_TIME), ((25.0,), (25.0 - COOLING,))),
    )


def record(sensor: Sensor, seed: int, imperfections: Imperfections | None, device: Sensor | None = None) -> Recording:
    """Return a recording of the simulated board with this seed; the true forces are the reference."""
    scene = pressing_scene(sensor)
    times, counts, temperatures, forces = [], [], [], []
    for scan, truth in wire_scans(device or sensor, scene, scene.period, seed, imperfections):
        times.append(truth.time)
        counts.append(scan.counts.copy())
        temperatures.append(float(np.mean(scan.temperatures)))
        forces.append(truth.force)
    time = np.array(times)
    return Recording(
        time=time,
        counts=np.array(counts),
        temperature=even_temperature(time, np.array(temperatures)),
        force=np.array(forces),
    )


def calibrate(
    sensor: Sensor, seed: int, imperfections: Imperfections | None = None, device: Sensor | None = None
) -> Calibration:
    """Return the calibration of the simulated board with this seed."""
    return fit(sensor, record(sensor, seed, imperfections, device), _now())


def _now() -> str:
    return datetime.now(timezone.utc).isoformat("T", "seconds")
