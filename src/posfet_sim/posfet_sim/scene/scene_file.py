# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scenes from YAML files, validated against the sensor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from posfet_model.config import Section, find_file, read_yaml
from posfet_model.sensor.description import Sensor
from posfet_sim.contact.indenters import FLAT, Bend, FlatIndenter, Shape, Sphere
from posfet_sim.contact.taxel_forces import Cells, skin_spread
from posfet_sim.defaults import SEED_MAX
from posfet_sim.scene.heat_transfer import chip_temperature_rise
from posfet_sim.scene.keyframes import Keyframes
from posfet_sim.scene.path_file import read_path
from posfet_sim.scene.scene import ChipBend, Scene, SceneObject
from posfet_sim.scene.trajectory_file import TIME_MAX, Limits, keyframe_time, keyframes

SCENE_FOLDER: Final = Path(__file__).parent / "scenes"
"""Folder of the shipped scenes."""

TEMPERATURE_RANGE: Final = (-40.0, 100.0)
"""Allowed temperatures [degC]; assumed: the copolymer is poled and operated well below its Curie temperature."""

MAX_OBJECTS: Final = 64
"""Largest number of objects; each takes time to load and to simulate."""

_LENGTH_RANGE: Final = (0.1, 1000.0)


def load_scene(name: str | Path, sensor: Sensor) -> Scene:
    """Return the scene of a YAML file, validated against the sensor.

    Parameters
    ----------
    name : str or Path
        Path of a file, or the bare name of a shipped scene.
    sensor : Sensor
        Sensor description.

    Returns
    -------
    Scene
        The scene, in SI units.

    Raises
    ------
    ConfigError
        A key is missing, unknown or duplicate, a type is wrong, a value is NaN, keyframes are not in ascending order or
        do not fit the period, an object is off the chip, or a force exceeds the range of the sensor. The message is one
        line naming file, key, allowed range and value.
    """
    top = read_yaml(find_file(str(name), SCENE_FOLDER, "scene", "listed by posfet scene and in docs/scenes.md"))
    period = top.number("period_s", 0, TIME_MAX, exclusive=True) if "period_s" in top else math.inf
    bend = _bend(top, sensor)
    thickness = top.number("cover_thickness_mm", 0.01, 20) * 1e-3 if "cover_thickness_mm" in top else None
    cells = Cells(sensor.layout, sensor.device.contact_spread if thickness is None else skin_spread(thickness))
    objects = top.sections("objects")
    if len(objects) > MAX_OBJECTS:
        raise top.error("objects", f"must hold at most {MAX_OBJECTS} objects, got {len(objects)}")
    scene = Scene(
        name=top.text("name"),
        description=top.text("description"),
        period=period,
        objects=tuple(_object(section, sensor, cells, bend, period) for section in objects),
        temperature=_temperature(top, period),
        bend=bend,
        skin_thickness=thickness,
    )
    top.end()
    names = [item.name for item in scene.objects]
    for index, item in enumerate(names):
        if item in names[:index]:
            raise top.error(f"objects[{index}].name", f"must differ from the other objects' names, got '{item}'")
    return replace(scene, temperature_rise=chip_temperature_rise(scene, sensor))


def max_force(sensor: Sensor, cells: Cells, shape: Shape, bend: Bend = FLAT) -> float:
    """Return the maximum normal force of a shape on a sensor.

    At this force either the taxel under the shape reaches the full-scale force of the sensor, or the contact theory
    ends.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    cells : Cells
        Cells of its array.
    shape : Shape
        Shape of the object.
    bend : tuple of float
        Curvatures of the chip along and across the object [1/m].

    Returns
    -------
    float
        Force [N].
    """
    x, y = sensor.layout.positions[sensor.layout.cols // 2 + sensor.layout.rows // 2 * sensor.layout.cols].reshape(2, 1)

    def peak(force: float) -> float:
        footprints = [shape.footprints(force, cells.spread, bend)]
        patch = cells.press(footprints, x, y, np.zeros(1), np.array([force]))
        return 0.0 if patch is None else float(patch.force.max())

    low, high = 0.0, shape.max_force
    if peak(high) <= sensor.device.force_max:
        return high
    high = min(high, sensor.device.force_max)
    while peak(high) <= sensor.device.force_max:
        low, high = high, 2 * high
    while high - low > 1e-6 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if peak(middle) <= sensor.device.force_max else (low, middle)
    return low


def _object(section: Section, sensor: Sensor, cells: Cells, bend: ChipBend | None, period: float) -> SceneObject:
    name = section.text("name")
    shape = SHAPES[section.text("kind", tuple(SHAPES))](section)
    under = FLAT if bend is None else bend.along(0.0)
    if bend is not None and shape.needs_flat_chip:
        raise section.error("length_mm", "a rectangular indenter needs a flat chip; a circular one has radius_mm")
    force = max_force(sensor, cells, shape, under)
    limits = Limits(
        half_x=sensor.layout.cols * sensor.layout.pitch_x / 2,
        half_y=sensor.layout.rows * sensor.layout.pitch_y / 2,
        force=force,
        indentation=None if shape.needs_force else shape.indentation(force, under),
        period=period,
    )
    path, by_indentation = read_path(section, limits)
    temperature = section.number("temperature_degC", *TEMPERATURE_RANGE) if "temperature_degC" in section else None
    section.end()
    return SceneObject(name, shape, path, by_indentation, temperature)


def _length(section: Section, name: str) -> float:
    return section.number(name, *_LENGTH_RANGE) * 1e-3


def _modulus(section: Section) -> float:
    return section.number("effective_modulus_MPa", 1e-3, 1e6) * 1e6


def _sphere(section: Section) -> Shape:
    return Sphere(_length(section, "radius_mm"), _modulus(section))


def _cylinder(section: Section) -> Shape:
    from posfet_sim.contact.line_contacts import Cylinder  # noqa: PLC0415  # loaded on use

    return Cylinder(_length(section, "length_mm"), _modulus(section), _length(section, "radius_mm"))


def _flat_indenter(section: Section) -> Shape:
    if "length_mm" in section:
        from posfet_sim.contact.rectangular_indenter import MAX_ASPECT_RATIO, RectangularIndenter  # noqa: PLC0415

        length, width = _length(section, "length_mm"), _length(section, "width_mm")
        if not 1 / MAX_ASPECT_RATIO <= length / width <= MAX_ASPECT_RATIO:
            allowed = f"must be in 1/{MAX_ASPECT_RATIO:g} to {MAX_ASPECT_RATIO:g} times width_mm"
            raise section.error("length_mm", f"{allowed}, got {length / width:g} times")
        return RectangularIndenter(length, width, _modulus(section))
    return FlatIndenter(_length(section, "radius_mm"), _modulus(section))


def _edge(section: Section) -> Shape:
    from posfet_sim.contact.line_contacts import Edge  # noqa: PLC0415  # loaded on use

    slope = math.tan(math.radians(section.number("flank_angle_deg", 1, 60)))
    return Edge(_length(section, "length_mm"), _modulus(section), slope)


def _pad(section: Section) -> Shape:
    from posfet_sim.contact.soft_faces import Pad  # noqa: PLC0415  # loaded on use

    return Pad(_length(section, "length_mm"), _length(section, "width_mm"))


def _ring(section: Section) -> Shape:
    from posfet_sim.contact.soft_faces import Ring  # noqa: PLC0415  # loaded on use

    outer = _length(section, "outer_radius_mm")
    inner = section.number("inner_radius_mm", _LENGTH_RANGE[0], outer * 1e3, exclusive=True) * 1e-3
    return Ring(outer, inner)


def _screw_head(section: Section) -> Shape:
    from posfet_sim.contact.soft_faces import ScrewHead  # noqa: PLC0415  # loaded on use

    radius = _length(section, "radius_mm")
    return ScrewHead(radius, section.number("slot_width_mm", 0, 2e3 * radius, exclusive=True) * 1e-3)


def _ridged_fingertip(section: Section) -> Shape:
    from posfet_sim.contact.ridged_fingertip import RidgedFingertip  # noqa: PLC0415  # loaded on use

    radius, modulus = _length(section, "radius_mm"), _modulus(section)
    spacing = section.number("ridge_spacing_mm", 0.1, 1000) * 1e-3
    return RidgedFingertip(radius, modulus, spacing, section.number("ridge_contrast_percent", 0, 100) * 1e-2)


def _texture(section: Section) -> Shape:
    from posfet_sim.contact.textured_pads import Ridges, Roughness  # noqa: PLC0415  # loaded on use

    length, width = _length(section, "length_mm"), _length(section, "width_mm")
    if section.text("profile", ("ridges", "bumps")) == "bumps":
        return Roughness(length, width, section.whole("bumps", 1, 1000), section.whole("seed", 0, SEED_MAX))
    ridges = section.whole("ridges", 1, 200)
    return Ridges(length, width, ridges, section.number("amplitude_um", 0, 1000) * 1e-6, _modulus(section))


SHAPES: Final[dict[str, Callable[[Section], Shape]]] = {
    "sphere": _sphere,
    "cylinder": _cylinder,
    "punch": _flat_indenter,
    "edge": _edge,
    "texture": _texture,
    "pad": _pad,
    "ring": _ring,
    "screw_head": _screw_head,
    "ridged_fingertip": _ridged_fingertip,
}
"""Reader of each kind of object."""


def _bend(top: Section, sensor: Sensor) -> ChipBend | None:
    """Read the bend of the chip, at most half a circle; by default that of the sensor file."""
    if "bend_radius_mm" not in top:
        bent = not math.isinf(sensor.layout.bend_radius)
        return ChipBend(sensor.layout.bend_radius, sensor.layout.bend_axis == "x") if bent else None
    axis_x = top.text("bend_axis", ("x", "y")) == "x"
    layout = sensor.layout
    span = layout.rows * layout.pitch_y if axis_x else layout.cols * layout.pitch_x
    smallest = max(span / math.pi, 1e-3)
    return ChipBend(top.number("bend_radius_mm", math.ceil(smallest * 1e5) / 100, 1e5) * 1e-3, axis_x)


def _temperature(top: Section, period: float) -> Keyframes:
    """Read the temperature of the chip: one number, or keyframes."""
    if "temperature_keyframes" not in top:
        return Keyframes((0.0,), ((top.number("temperature_degC", *TEMPERATURE_RANGE),),))
    if "temperature_degC" in top:
        raise top.error("temperature_degC", "must not be given together with temperature_keyframes")
    sections = keyframes(top, "temperature_keyframes")
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for keyframe in sections:
        times.append(keyframe_time(keyframe, times, period))
        values.append((keyframe.number("temperature_degC", *TEMPERATURE_RANGE),))
        keyframe.end()
    if math.isfinite(period) and values[0] != values[-1]:
        raise sections[-1].error("temperature_degC", f"must be {values[0][0]:g} as at first, got {values[-1][0]:g}")
    return Keyframes(tuple(times), tuple(values))
