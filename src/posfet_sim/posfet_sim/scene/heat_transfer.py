"""Heat of objects that are warmer or colder than the chip.

One heat capacity C for the whole chip, which silicon keeps at one temperature. An object at the temperature To feeds it
through the cover over its area of contact A: ``k*A/h*(To - T)``. What it is warmer by, W, is lost to the board with the
time constant tau: ``C*dW/dt = sum(k*A/h*(To - T)) - C*W/tau``. The scene's own temperature is what the chip would have
without objects; T is that and W. The object's temperature does not change, the cover stores no heat, and the film above
the silicon has its temperature (it differs by some 1e-3 of To - T).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model.sensor.description import Sensor
from posfet_sim.contact.taxel_forces import SPREAD_PER_THICKNESS
from posfet_sim.scene.scene import Scene, Warming

COVER_CONDUCTIVITY: Final = 0.2
"""k [W/(m K)]; assumed: silicone rubber."""

CHIP_THICKNESS: Final = 450e-6
"""Of the silicon [m]; the paper, section II."""

SILICON_HEAT: Final = 1.63e6
"""Heat capacity per volume [J/(m3 K)]; 700 J/(kg K) times 2330 kg/m3."""

LOSS_TIME_CONSTANT: Final = 10.0
"""tau [s]; assumed."""

_STEP: Final = 5e-3  # [s]; the temperature goes in a straight line over it
_MOST_STEPS: Final = 50_000
_TAIL: Final = 12.0  # time constants after the last change: exp(-12) = 6e-6
_NOTICED: Final = 1e-6  # [K]; smaller changes wait until they add up to it: 1e-6 N on a taxel


@dataclass(frozen=True)
class _Chip:
    capacity: float
    """C [J/K]."""
    conductance: float
    """k/h of the cover [W/(m2 K)]."""


def warming(scene: Scene, sensor: Sensor) -> Warming | None:
    """Return how the objects warm the chip over a scene; None when none of them has a temperature.

    A scene that repeats is taken as having repeated for ever; one that plays once begins without warming.
    """
    if all(item.temperature is None for item in scene.objects):
        return None
    layout = sensor.layout
    area = layout.cols * layout.pitch_x * layout.rows * layout.pitch_y
    thickness = scene.cover_thickness or max(sensor.device.contact_spread / SPREAD_PER_THICKNESS, 1e-5)
    chip = _Chip(area * CHIP_THICKNESS * SILICON_HEAT, COVER_CONDUCTIVITY / thickness)
    repeats = math.isfinite(scene.period)
    span = scene.period if repeats else scene.duration + _TAIL * LOSS_TIME_CONSTANT
    count = min(max(math.ceil(span / _STEP), 1), _MOST_STEPS)
    step = span / count
    gains = [_gain(scene, chip, (index + 0.5) * step, step) for index in range(count)]
    start = 0.0
    if repeats:
        decay, end = 1.0, 0.0
        for share, goal in gains:
            decay, end = decay * share, goal + (end - goal) * share
        start = end / (1 - decay)
    values = [start]
    exact = start
    for share, goal in gains:
        exact = goal + (exact - goal) * share
        values.append(exact if abs(exact - values[-1]) > _NOTICED else values[-1])
    if repeats:
        values[-1] = start
    return Warming(step, tuple(values))


def _gain(scene: Scene, chip: _Chip, time: float, step: float) -> tuple[float, float]:
    """Return by how much W keeps its distance from its goal over a step, and that goal [K], as of a time [s]."""
    conductance, flow = chip.capacity / LOSS_TIME_CONSTANT, 0.0
    (own,) = scene.temperature.at(time)
    for item, state in zip(scene.objects, scene.states(time), strict=True):
        if item.temperature is not None and state.force > 0:
            share = chip.conductance * item.shape.area(state.force, scene.bend_along(item, state.angle))
            conductance += share
            flow += share * (item.temperature - own)
    return math.exp(-conductance / chip.capacity * step), flow / conductance
