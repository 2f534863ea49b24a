"""What touches a simulated board over time, read from a YAML file (docs/scenes.md).

Between two keyframes every value moves as ``v0 + (v1 - v0)*(10*u^3 - 15*u^4 + 6*u^5)``, u from 0 to 1: the path of
least jerk from rest to rest (Flash and Hogan, J. Neurosci. 5(7), 1985, eq. 1). It never overshoots, and velocity and
acceleration are 0 at each keyframe. Before the first keyframe its values hold, after the last one the last values.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from posfet_driver.contact_pressure import FORCE_LIMIT, SphereOnArray
from posfet_model.config import Section, find_file, read_yaml
from posfet_model.sensor import Layout, Sensor

SCENE_FOLDER: Final = Path(__file__).parent / "scenes"
"""Folder of the scenes that are shipped."""

DEFAULT_SCENE: Final = "press_slide_lift"
TIME_MAX: Final = 1e6
"""Longest scene [s]."""

TEMPERATURE_RANGE: Final = (-40.0, 100.0)
"""Accepted chip temperatures [degC]; assumed: the copolymer is poled and read well below its Curie point."""


@dataclass(frozen=True)
class Track:
    """Values over time through keyframes."""

    times: tuple[float, ...]
    """Times of the keyframes [s], ascending, at least one."""
    values: tuple[tuple[float, ...], ...]
    """Values at each keyframe."""

    def at(self, time: float) -> tuple[float, ...]:
        """Return the values at a time [s] of the scene."""
        index = bisect_right(self.times, time) - 1
        if index < 0:
            return self.values[0]
        start = self.values[index]
        if index + 1 == len(self.times):
            return start
        end = self.values[index + 1]
        if start == end:
            return start
        u = (time - self.times[index]) / (self.times[index + 1] - self.times[index])
        share = min(u * u * u * (10 + u * (6 * u - 15)), 1.0)  # rounding may carry it past 1, and a force below 0
        return tuple([a + (b - a) * share for a, b in zip(start, end, strict=True)])


@dataclass(frozen=True)
class Sphere:
    """A ball, or a round fingertip."""

    name: str
    radius: float
    """R [m]."""
    effective_modulus: float
    """E [Pa] of both sides: 1/E = (1 - nu1^2)/E1 + (1 - nu2^2)/E2."""
    path: Track
    """x, y [m] in the frame of the array, and normal force [N]."""


@dataclass(frozen=True)
class Scene:
    """Objects and temperature over time; after `period` it begins anew."""

    name: str
    description: str
    period: float
    """Time after which the scene repeats [s]; infinite when it plays once."""
    objects: tuple[Sphere, ...]
    temperature: Track
    """Temperature of the chip [degC]."""

    def local_time(self, time: float) -> float:
        """Return the time within the period [s] for a time since the start [s]."""
        return math.fmod(time, self.period)

    def rests_until(self, time: float) -> float:
        """Return the time [s] up to which, from `time` on, no force and no temperature changes; `time` when one does.

        An object that moves without touching is at rest. Infinite when nothing will ever change again.
        """
        local = self.local_time(time)
        starts, ends = self._changes
        index = bisect_right(ends, local)
        if index < len(ends):
            return time + max(starts[index] - local, 0.0)
        return time + (self.period - local) + starts[0] if starts else math.inf

    @cached_property
    def _changes(self) -> tuple[Sequence[float], Sequence[float]]:
        """Starts and ends of the times of the scene [s] in which a force or the temperature changes, disjoint."""
        spans = _changing(self.temperature, lambda a, b: a == b)
        for item in self.objects:
            spans += _changing(item.path, lambda a, b: a == b or a[-1] == b[-1] == 0)
        starts: list[float] = []
        ends: list[float] = []
        for start, end in sorted(spans):
            if ends and start <= ends[-1]:
                ends[-1] = max(ends[-1], end)
            else:
                starts.append(start)
                ends.append(end)
        return starts, ends


def greatest_force(sensor: Sensor, radius: float, effective_modulus: float) -> float:
    """Return the greatest normal force [N] that a sphere may press with on this sensor.

    At it, either the taxel straight under the sphere has the sensor's greatest force, or the contact is as wide as the
    sphere itself, where Hertz theory has long ended. Raises ValueError as `SphereOnArray` does.
    """
    sphere = SphereOnArray(sensor.layout, sensor.device.contact_spread, radius, effective_modulus)
    x, y = sensor.layout.positions[sensor.layout.cols // 2 + sensor.layout.rows // 2 * sensor.layout.cols]

    def peak(force: float) -> float:
        forces = np.zeros((sensor.layout.rows, sensor.layout.cols))
        sphere.add(forces, float(x), float(y), force)
        return float(forces.max())

    low, high = 0.0, min(4 / 3 * effective_modulus * radius**2, FORCE_LIMIT)
    if peak(high) <= sensor.device.force_max:
        return high
    while high - low > 1e-6 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if peak(middle) <= sensor.device.force_max else (low, middle)
    return low


def load_scene(name: str | Path, sensor: Sensor) -> Scene:
    """Return the scene described by a YAML file, or by the bare name of a shipped one, checked against the sensor.

    Raises ConfigError, one line naming file, key, allowed range and value: for a missing, unknown or repeated key, a
    wrong type, NaN, keyframes that are not in the order of time or do not fit the period, an object off the chip, or a
    force above the sensor's range.
    """
    top = read_yaml(find_file(str(name), SCENE_FOLDER, "scene"))
    period = top.number("period_s", 0, TIME_MAX, exclusive=True) if "period_s" in top else math.inf
    scene = Scene(
        name=top.text("name"),
        description=top.text("description"),
        period=period,
        objects=tuple(_sphere(section, sensor, period) for section in top.sections("objects")),
        temperature=_temperature(top, period),
    )
    top.end()
    names = [item.name for item in scene.objects]
    for index, item in enumerate(names):
        if item in names[:index]:
            raise top.error(f"objects[{index}].name", f"must differ from the other objects' names, got '{item}'")
    return scene


def _sphere(section: Section, sensor: Sensor, period: float) -> Sphere:
    name = section.text("name")
    section.text("kind", ("sphere",))
    radius = section.number("radius_mm", 0.1, 1000) * 1e-3
    modulus = section.number("effective_modulus_MPa", 1e-3, 1e6) * 1e6
    highest = greatest_force(sensor, radius, modulus)
    path = _path(section, sensor.layout, highest, period)
    section.end()
    return Sphere(name, radius, modulus, path)


def _path(section: Section, layout: Layout, highest: float, period: float) -> Track:
    """Read the keyframes of an object: x, y [m] and force [N] up to `highest`."""
    half_x = layout.cols * layout.pitch_x / 2 * 1e3
    half_y = layout.rows * layout.pitch_y / 2 * 1e3
    keyframes = _keyframes(section, "keyframes")
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for keyframe in keyframes:
        times.append(_time(keyframe, times, period))
        x = keyframe.number("x_mm", -half_x, half_x) * 1e-3
        y = keyframe.number("y_mm", -half_y, half_y) * 1e-3
        values.append((x, y, keyframe.number("force_N", 0, highest)))
        keyframe.end()
    first, last = values[0], values[-1]
    if math.isfinite(period) and first != last and (first[-1] > 0 or last[-1] > 0):
        raise keyframes[-1].error(
            "force_N", "a scene with a period_s must end as it begins: without touch, or at the first keyframe's values"
        )
    return Track(tuple(times), tuple(values))


def _temperature(top: Section, period: float) -> Track:
    """Read the chip's temperature: one number, or keyframes."""
    if "temperature_keyframes" not in top:
        return Track((0.0,), ((top.number("temperature_degC", *TEMPERATURE_RANGE),),))
    if "temperature_degC" in top:
        raise top.error("temperature_degC", "must not be given together with temperature_keyframes")
    keyframes = _keyframes(top, "temperature_keyframes")
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for keyframe in keyframes:
        times.append(_time(keyframe, times, period))
        values.append((keyframe.number("temperature_degC", *TEMPERATURE_RANGE),))
        keyframe.end()
    if math.isfinite(period) and values[0] != values[-1]:
        raise keyframes[-1].error("temperature_degC", f"must be {values[0][0]:g} as at first, got {values[-1][0]:g}")
    return Track(tuple(times), tuple(values))


def _keyframes(section: Section, name: str) -> list[Section]:
    keyframes = section.sections(name)
    if not keyframes:
        raise section.error(name, "must hold at least one keyframe, got none")
    return keyframes


def _time(keyframe: Section, before: Sequence[float], period: float) -> float:
    """Read the time of a keyframe, which must be after the one before and within the period."""
    time = keyframe.number("time_s", 0, min(period, TIME_MAX))
    if before and time <= before[-1]:
        raise keyframe.error("time_s", f"must be after {before[-1]:g}, the keyframe before, got {time:g}")
    return time


def _changing(track: Track, rests: Callable[[tuple[float, ...], tuple[float, ...]], bool]) -> list[tuple[float, float]]:
    """Return start and end [s] of the parts of a track over which `rests` (start values, end values) is not true."""
    return [
        (track.times[index], track.times[index + 1])
        for index in range(len(track.times) - 1)
        if not rests(track.values[index], track.values[index + 1])
    ]
