# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Heat transfer between the chip and objects of another temperature.

The chip is one heat capacity C, as silicon has a uniform temperature. An object at the temperature To heats it through
the elastomer skin over the contact area A: ``k*A/h*(To - T)``. The temperature rise W that the objects cause decays to
the board with the time constant tau: ``C*dW/dt = sum(k*A/h*(To - T)) - C*W/tau``. The temperature of the scene is that
of the chip without objects; T is their sum. The temperature of an object is constant, the skin stores no heat, and the
film has the temperature of the silicon below it (the difference is about 1e-3 of To - T).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model.sensor.description import Sensor
from posfet_sim.contact.taxel_forces import SPREAD_PER_THICKNESS
from posfet_sim.scene.scene import Scene, TemperatureRise

SKIN_CONDUCTIVITY: Final = 0.2
"""Thermal conductivity k of the elastomer skin [W/(m K)]; assumed: silicone rubber."""

CHIP_THICKNESS: Final = 450e-6
"""Thickness of the silicon [m]; the paper, section II."""

SILICON_HEAT: Final = 1.63e6
"""Volumetric heat capacity of silicon [J/(m3 K)]; 700 J/(kg K) times 2330 kg/m3."""

LOSS_TIME_CONSTANT: Final = 10.0
"""Time constant tau of the heat loss to the board [s]; assumed."""

_STEP: Final = 5e-3  # [s]; the temperature is linear over it
_MAX_STEPS: Final = 50_000
_TAIL: Final = 12.0  # time constants after the last change: exp(-12) = 6e-6
_RESOLUTION: Final = 1e-6  # [K]; smaller changes accumulate until they exceed it: 1e-6 N on a taxel


@dataclass(frozen=True)
class _Chip:
    capacity: float
    """Heat capacity C [J/K]."""
    conductance: float
    """k/h of the elastomer skin [W/(m2 K)]."""


def chip_temperature_rise(scene: Scene, sensor: Sensor) -> TemperatureRise | None:
    """Return the temperature rise of the chip that the objects of a scene cause.

    A periodic scene is in its periodic steady state; a scene that plays once starts without a rise.

    Parameters
    ----------
    scene : Scene
        Scene; its own `temperature_rise` is not used.
    sensor : Sensor
        Sensor description.

    Returns
    -------
    TemperatureRise or None
        None when no object has a temperature.
    """
    if all(item.temperature is None for item in scene.objects):
        return None
    layout = sensor.layout
    area = layout.cols * layout.pitch_x * layout.rows * layout.pitch_y
    thickness = scene.skin_thickness or max(sensor.device.contact_spread / SPREAD_PER_THICKNESS, 1e-5)
    chip = _Chip(area * CHIP_THICKNESS * SILICON_HEAT, SKIN_CONDUCTIVITY / thickness)
    repeats = math.isfinite(scene.period)
    span = scene.period if repeats else scene.duration + _TAIL * LOSS_TIME_CONSTANT
    count = min(max(math.ceil(span / _STEP), 1), _MAX_STEPS)
    step = span / count
    responses = [_step_response(scene, chip, (index + 0.5) * step, step) for index in range(count)]
    start = 0.0
    if repeats:
        decay, end = 1.0, 0.0
        for factor, steady in responses:
            decay, end = decay * factor, steady + (end - steady) * factor
        start = end / (1 - decay)
    values = [start]
    exact = start
    for factor, steady in responses:
        exact = steady + (exact - steady) * factor
        values.append(exact if abs(exact - values[-1]) > _RESOLUTION else values[-1])
    if repeats:
        values[-1] = start
    return TemperatureRise(step, tuple(values))


def _step_response(scene: Scene, chip: _Chip, time: float, step: float) -> tuple[float, float]:
    """Return the decay factor of W over a step [1] and the steady state it decays to [K], at a time [s]."""
    conductance, flow = chip.capacity / LOSS_TIME_CONSTANT, 0.0
    (own,) = scene.temperature.at(time)
    for item, state in zip(scene.objects, scene.states(time), strict=True):
        if item.temperature is not None and state.force > 0:
            coupling = chip.conductance * item.shape.area(state.force, scene.bend_along(item, state.angle))
            conductance += coupling
            flow += coupling * (item.temperature - own)
    return math.exp(-conductance / chip.capacity * step), flow / conductance
