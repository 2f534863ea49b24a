# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scenes: valid files are simulated as described, invalid ones are rejected with a one-line error."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_sim.contact.indenters import FlatIndenter, Sphere
from posfet_sim.contact.line_contacts import Cylinder, Edge
from posfet_sim.contact.rectangular_indenter import RectangularIndenter
from posfet_sim.contact.ridged_fingertip import RidgedFingertip
from posfet_sim.contact.soft_faces import Pad, Ring, ScrewHead
from posfet_sim.contact.taxel_forces import Cells
from posfet_sim.contact.textured_pads import Ridges, Roughness
from posfet_sim.scene import (
    SCENE_FOLDER,
    ChipBend,
    Keyframes,
    Scene,
    SceneLoads,
    SceneObject,
    load_scene,
    pattern_file,
    scene_file,
    trajectory_file,
)
from posfet_sim.scene.scene_file import SHAPES, max_force
from support.each_row import each_row
from support.paths import DOCS

SENSOR = load_sensor()
DOCUMENT = (DOCS / "scenes.md").read_text(encoding="utf-8")
SHIPPED = sorted(path.stem for path in SCENE_FOLDER.glob("*.yaml"))

FIRST_CONTACT = dict.fromkeys(
    ("flat_pad_fast", "flat_pad_slow", "hold", "hold_10s", "hold_300s", "hold_fluctuating", "mixed", "overload"), 1.0
) | {"slow_press": 1.0, "contact_at_power_on": 0.0}
"""Time of the first contact [s], where it is not 0.3 s: the longer a force is held, the more accurate its offset has to
be."""

MAX_LOAD = {"overload": 20.0, "slow_press": 0.2, "hold_fluctuating": 2.1}
"""Maximum force of an object [N], where it is not in [0.5, 2]."""

GOOD = """\
name: good
description: a ball presses and lifts
period_s: 2.0
temperature_degC: 25.0
objects:
  - name: ball
    kind: sphere
    radius_mm: 5.0
    effective_modulus_MPa: 2.0
    keyframes:
      - {time_s: 0.5, x_mm: 1.0, y_mm: -2.0, force_N: 0.0}
      - {time_s: 1.0, x_mm: 1.0, y_mm: -2.0, force_N: 1.5}
      - {time_s: 1.5, x_mm: -1.0, y_mm: 2.0, force_N: 0.0}
"""
SECOND = """\
  - name: ball
    kind: sphere
    radius_mm: 5.0
    effective_modulus_MPa: 2.0
    keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, force_N: 0}]
"""
BENT_PUNCH = """temperature_degC: 25.0
bend_radius_mm: 20
bend_axis: x
objects:
  - name: block
    kind: punch
    length_mm: 4
    width_mm: 2
    """
RAMP = """temperature_keyframes:
  - {time_s: 0.0, temperature_degC: 20.0}
  - {time_s: 1.0, temperature_degC: 30.0}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read_into_si_units(tmp_path: Path) -> None:
    scene = load_scene(write(tmp_path, GOOD), SENSOR)
    expected = Scene(
        name="good",
        description="a ball presses and lifts",
        period=2.0,
        objects=(
            SceneObject(
                name="ball",
                shape=Sphere(5e-3, 2e6),
                path=Keyframes(
                    (0.5, 1.0, 1.5), ((1e-3, -2e-3, 0.0, 0.0), (1e-3, -2e-3, 0.0, 1.5), (-1e-3, 2e-3, 0.0, 0.0))
                ),
            ),
        ),
        temperature=Keyframes((0.0,), ((25.0,),)),
    )
    assert scene == expected


@pytest.mark.parametrize(
    ("lines", "shape"),
    [
        ("kind: sphere, radius_mm: 5.0, effective_modulus_MPa: 2.0", Sphere(5e-3, 2e6)),
        ("kind: punch, radius_mm: 1.5, effective_modulus_MPa: 2.0", FlatIndenter(1.5e-3, 2e6)),
        (
            "kind: punch, length_mm: 4, width_mm: 0.2, effective_modulus_MPa: 2",
            RectangularIndenter(4e-3, 0.2e-3, 2e6),
        ),
        ("kind: cylinder, radius_mm: 3, length_mm: 4, effective_modulus_MPa: 2", Cylinder(4e-3, 2e6, 3e-3)),
        (
            "kind: edge, length_mm: 4, flank_angle_deg: 45, effective_modulus_MPa: 2",
            Edge(4e-3, 2e6, math.tan(math.pi / 4)),
        ),
        (
            "kind: texture, profile: ridges, length_mm: 6, width_mm: 3, ridges: 3, amplitude_um: 16,"
            " effective_modulus_MPa: 2",
            Ridges(6e-3, 3e-3, 3, 16e-6, 2e6),
        ),
        ("kind: texture, profile: bumps, length_mm: 6, width_mm: 3, bumps: 9, seed: 4", Roughness(6e-3, 3e-3, 9, 4)),
        ("kind: pad, length_mm: 6, width_mm: 3", Pad(6e-3, 3e-3)),
        ("kind: ring, outer_radius_mm: 3, inner_radius_mm: 2.5", Ring(3e-3, 2.5e-3)),
        ("kind: screw_head, radius_mm: 2, slot_width_mm: 0.5", ScrewHead(2e-3, 0.5e-3)),
        (
            "kind: ridged_fingertip, radius_mm: 8, effective_modulus_MPa: 1, ridge_spacing_mm: 2,"
            " ridge_contrast_percent: 50",
            RidgedFingertip(8e-3, 1e6, 2e-3, 0.5),
        ),
    ],
)
def test_each_object_kind_is_read(tmp_path: Path, lines: str, shape: object) -> None:
    text = (
        GOOD[: GOOD.index("  - name")]
        + f"  - {{name: it, {lines}, keyframes: [{{time_s: 0, x_mm: 0, y_mm: 0, force_N: 0}}]}}\n"
    )
    scene = load_scene(write(tmp_path, text), SENSOR)
    assert scene.objects[0].shape == shape


def test_a_bent_chip_and_a_cover_are_read(tmp_path: Path) -> None:
    text = GOOD.replace("objects:", "bend_radius_mm: 20\nbend_axis: y\ncover_thickness_mm: 1.0\nobjects:")
    scene = load_scene(write(tmp_path, text), SENSOR)
    assert scene.bend == ChipBend(0.02, axis_x=False)
    assert scene.skin_thickness == 1e-3


def test_temperature_by_keyframes_and_no_period(tmp_path: Path) -> None:
    text = GOOD.replace("temperature_degC: 25.0\n", RAMP).replace("period_s: 2.0\n", "")
    scene = load_scene(write(tmp_path, text), SENSOR)
    assert math.isinf(scene.period)
    assert scene.duration == 1.5
    assert scene.temperature.at(0.5) == (25.0,)
    assert scene.local_time(1e5) == 1e5


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes(name: str) -> None:
    scene = load_scene(name, SENSOR)
    assert scene.name == name
    rest = FIRST_CONTACT.get(name, 0.3)
    for item in scene.objects:
        if name in MAX_LOAD:
            assert item.path.max_load() == MAX_LOAD[name]
        else:
            assert 0.5 <= item.path.max_load() <= 2.0
        if name == "contact_at_power_on":
            assert item.path.at(rest)[-1] == 1.0
            continue
        assert item.path.at(rest)[-1] == 0
        if name != "warm_finger":  # the chip cools from the touch before
            assert scene.constant_until(0.0) == pytest.approx(rest, abs=1e-12)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scene_begins_with_what_it_is_for(name: str) -> None:
    lines = (SCENE_FOLDER / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    paragraph = " ".join(line.removeprefix("# ") for line in lines[2 : lines.index(f"name: {name}")])
    assert lines[1] == "#"
    assert len(paragraph) > 80
    assert "#" not in paragraph
    assert paragraph.endswith(".")


def test_all_documented_scenes_are_shipped() -> None:
    assert set(SHIPPED) >= {"press", "slide", "press_slide_lift", "two_fingers", "tap", "vibration", "texture", "hold"}
    assert set(SHIPPED) >= {"temperature_ramp", "grasp_lift_slip", "idle"}
    loads = {name: SceneLoads(load_scene(name, SENSOR), SENSOR) for name in SHIPPED}
    assert loads["idle"].scene.duration == 600
    assert loads["idle"].constant_until(0.0) == math.inf
    held = [len(loads["hold"].forces([time])) for time in np.arange(1.4, 61.2, 1.0).tolist()]
    assert held == [1] * 60
    warm = loads["temperature_ramp"].temperatures(np.arange(0, 20, 0.1).tolist())
    assert max(warm) - min(warm) == 5.0
    assert not any(loads["temperature_ramp"].forces([time]) for time in np.arange(0, 20, 0.1).tolist())
    shaking = np.array([loads["vibration"].objects(time).contact_forces[0] for time in np.arange(1, 2, 1e-3).tolist()])
    spectrum = np.abs(np.fft.rfft(shaking - shaking.mean()))
    assert np.argmax(spectrum) == 200


REFUSED = [
    ("name: good\n", "", "name: missing, must be text"),
    ("name: good", "name: 3", "name: must be text, got 3"),
    ("name: good", "name: good\nspeed: 2", "speed: unknown key, known here are .*period_s, .*cover_thickness_mm"),
    ("name: good", "name: good\nname: good", "key 'name' is given twice"),
    ("description: a ball presses and lifts\n", "", "description: missing"),
    ("period_s: 2.0", "period_s: 0", r"period_s: must be a number in \(0, 1e\+06\), got 0"),
    ("period_s: 2.0", "period_s: .nan", "period_s: must be a number"),
    ("period_s: 2.0", "period_s: 1.2", r"keyframes\[2\].time_s: must be a number in \[0, 1.2\], got 1.5"),
    ("temperature_degC: 25.0\n", "", "temperature_degC: missing"),
    ("temperature_degC: 25.0", "temperature_degC: 101", r"temperature_degC: must be .* \[-40, 100\], got 101"),
    ("temperature_degC: 25.0", "temperature_degC: warm", "temperature_degC: must be a number"),
    ("objects:", "temperature_keyframes: []\nobjects:", "temperature_degC: must not be given together"),
    ("temperature_degC: 25.0", "temperature_keyframes: []", "temperature_keyframes: must hold at least one"),
    ("temperature_degC: 25.0\n", RAMP, r"temperature_keyframes\[1\].temperature_degC: must be 20 as at first"),
    ("objects:", "objects: []\nothers:", "others: unknown key"),
    ("name: ball", "title: ball", r"objects\[0\].name: missing, must be text"),
    (
        "    kind: sphere\n",
        "",
        rf"objects\[0\].kind: missing, must be one of {', '.join(SHAPES)}",
    ),
    (
        "kind: sphere",
        "kind: cube",
        rf"objects\[0\].kind: must be one of {', '.join(SHAPES)}, got 'cube'",
    ),
    ("radius_mm: 5.0", "radius_mm: -5.0", r"objects\[0\].radius_mm: must be .* \[0.1, 1000\], got -5"),
    ("radius_mm: 5.0\n", "radius_mm: 5.0\n    mass_g: 3\n", r"objects\[0\].mass_g: unknown key"),
    ("effective_modulus_MPa: 2.0", "effective_modulus_MPa: 0", "effective_modulus_MPa: must be .*, got 0"),
    ("{time_s: 1.0,", "{time_s: 0.5,", r"keyframes\[1\].time_s: must be after 0.5, the keyframe before, got 0.5"),
    ("{time_s: 1.0,", "{time_s: 0.4,", r"keyframes\[1\].time_s: must be after 0.5, the keyframe before, got 0.4"),
    ("{time_s: 0.5,", "{time_s: -0.5,", r"keyframes\[0\].time_s: must be a number in \[0, 2\], got -0.5"),
    ("x_mm: -1.0", "x_mm: 3.8", r"keyframes\[2\].x_mm: must be a number in \[-3.75, 3.75\], got 3.8"),
    ("y_mm: 2.0", "y_mm: -40", r"keyframes\[2\].y_mm: must be a number in \[-3.75, 3.75\], got -40"),
    ("y_mm: 2.0", "y_mm: .inf", r"keyframes\[2\].y_mm: must be a number"),
    ("y_mm: 2.0", "z_mm: 2.0", r"keyframes\[2\].y_mm: missing"),
    ("force_N: 1.5", "force_N: 1.5, spin: 1", r"keyframes\[1\].spin: unknown key"),
    ("force_N: 1.5", "force_N: -0.1", r"keyframes\[1\].force_N: must be a number in \[0, 66.6667\], got -0.1"),
    ("force_N: 1.5", "force_N: 67", r"keyframes\[1\].force_N: must be a number in \[0, 66.6667\], got 67"),
    ("force_N: 1.5", "force_N: 1.5e0 N", r"keyframes\[1\].force_N: must be a number"),
    ("y_mm: 2.0, force_N: 0.0", "y_mm: 2.0, force_N: 0.1", r"keyframes\[2\].force_N: a scene with a period_s"),
    ("kind: sphere", "kind: cylinder", r"objects\[0\].length_mm: missing"),
    (
        "kind: sphere\n    radius_mm: 5.0",
        "kind: punch\n    length_mm: 4.1\n    width_mm: 0.2",
        r"objects\[0\].length_mm: must be in 1/20 to 20 times width_mm, got 20.5 times",
    ),
    (
        "kind: sphere\n    radius_mm: 5.0\n    effective_modulus_MPa: 2.0",
        "kind: ring\n    outer_radius_mm: 2\n    inner_radius_mm: 2",
        r"objects\[0\].inner_radius_mm: must be a number in \(0.1, 2\), got 2",
    ),
    (
        "kind: sphere\n    radius_mm: 5.0\n    effective_modulus_MPa: 2.0",
        "kind: screw_head\n    radius_mm: 2\n    slot_width_mm: 4",
        r"objects\[0\].slot_width_mm: must be a number in \(0, 4\), got 4",
    ),
    ("kind: sphere", "kind: punch\n    length_mm: 4\n    width_mm: 2", r"objects\[0\].radius_mm: unknown key"),
    (
        GOOD[GOOD.index("temperature_degC") : GOOD.index("effective")],
        BENT_PUNCH,
        r"objects\[0\].length_mm: a rectangular indenter needs a flat chip",
    ),
    (
        "temperature_degC: 25.0",
        "temperature_degC: 25.0\nbend_radius_mm: 20",
        "bend_axis: missing, must be one of x, y",
    ),
    ("temperature_degC: 25.0", "temperature_degC: 25.0\nbend_axis: x", "bend_axis: unknown key"),
    (
        "temperature_degC: 25.0",
        "temperature_degC: 25.0\nbend_radius_mm: 2\nbend_axis: x",
        r"bend_radius_mm: must be a number in \[2.39, 100000\], got 2",
    ),
    (
        "temperature_degC: 25.0",
        "temperature_degC: 25.0\ncover_thickness_mm: 0",
        "cover_thickness_mm: must be .*, got 0",
    ),
    ("keyframes:", "path: {}\n    keyframes:", r"objects\[0\].keyframes: must not be given together with path"),
    ("force_N: 1.5", "indentation_mm: 0.1", r"keyframes\[1\].force_N: missing"),
    (
        "force_N: 1.5",
        "force_N: 1.5, angle_deg: 4000",
        r"keyframes\[1\].angle_deg: must be .* \[-3600, 3600\], got 4000",
    ),
    (GOOD[GOOD.index("      - {") :], "      []\n", "keyframes: must hold at least one keyframe"),
    (GOOD[GOOD.index("      - {") :], "      3\n", "keyframes: must be a list of mappings"),
]
"""Text replaced in the valid scene, its replacement, and the error message."""


def test_invalid_input_is_rejected_with_a_one_line_error(tmp_path: Path) -> None:
    with each_row() as row:
        for old, new, reason in REFUSED:
            with row(f"{new!r:.60} for {old!r:.60}"):
                assert old in GOOD
                path = write(tmp_path, GOOD.replace(old, new, 1))
                with pytest.raises(ConfigError, match=reason) as caught:
                    load_scene(path, SENSOR)
                message = str(caught.value)
                assert message.startswith(f"{path}: ")
                assert "\n" not in message


def test_duplicate_object_names_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"objects\[1\].name: must differ .*, got 'ball'"):
        load_scene(write(tmp_path, GOOD + SECOND), SENSOR)


def test_an_unknown_scene_error_says_where_the_shipped_scenes_are_listed() -> None:
    with pytest.raises(ConfigError) as raised:
        load_scene("no_such", SENSOR)
    assert str(raised.value) == (
        "no_such: no such scene; give the path of a YAML file or a shipped scene "
        "(listed by posfet scene and in docs/scenes.md)"
    )


def test_a_force_above_the_range_of_a_taxel_is_rejected_naming_the_taxel(tmp_path: Path) -> None:
    hard = GOOD.replace("effective_modulus_MPa: 2.0", "effective_modulus_MPa: 200.0")
    ball, cells = Sphere(5e-3, 200e6), Cells(SENSOR.layout, SENSOR.device.contact_spread)
    limit = max_force(SENSOR, cells, ball)
    where = [np.array([value]) for value in (0.0, 0.0, 0.0, limit)]
    patch = cells.press([ball.footprints(limit, cells.spread, (0.0, 0.0))], *where)
    assert patch is not None
    assert patch.force.max() == pytest.approx(SENSOR.device.force_max, rel=1e-5)
    load_scene(write(tmp_path, hard.replace("force_N: 1.5", f"force_N: {limit * 0.999}")), SENSOR)
    with pytest.raises(ConfigError, match=r"force_N: must be a number in \[0, "):
        load_scene(write(tmp_path, hard.replace("force_N: 1.5", f"force_N: {limit * 1.001}")), SENSOR)
    weaker = replace(SENSOR, device=replace(SENSOR.device, force_max=SENSOR.device.force_max / 2))
    assert max_force(weaker, cells, ball) < limit


PATHS = {
    "sine": "amplitude_N: 0.2, frequency_Hz: 200",
    "sweep": "amplitude_N: 0.2, frequency_Hz: 5, end_frequency_Hz: 300",
    "slide": "to_x_mm: 2, to_y_mm: 1, strokes: 3",
    "twist": "to_angle_deg: 90, strokes: 2",
    "random": "amplitude_N: 0.4, reach_mm: 1, bandwidth_Hz: 30, seed: 5",
}
TOUCH = "start_s: 0.2, end_s: 1.2, rise_s: 0.1, x_mm: 1, y_mm: -1, force_N: 0.5"
TAP = "path: {kind: tap, start_s: 0.2, contact_s: 0.02, interval_s: 0.1, count: 5, x_mm: 1, y_mm: -1, force_N: 0.5}"


def with_path(path: str) -> str:
    return GOOD[: GOOD.index("    keyframes:")] + f"    {path}\n"


@pytest.mark.parametrize("kind", PATHS)
def test_each_path_is_read_and_evaluated(tmp_path: Path, kind: str) -> None:
    scene = load_scene(write(tmp_path, with_path(f"path: {{kind: {kind}, {TOUCH}, {PATHS[kind]}}}")), SENSOR)
    path = scene.objects[0].path
    assert path.at(0.2)[-1] == path.at(1.2)[-1] == path.at(5.0)[-1] == 0
    assert path.at(0.7)[-1] > 0.05
    assert scene.constant_until(0.0) == pytest.approx(0.2)
    assert scene.constant_until(1.2) == pytest.approx(2.2)


@pytest.mark.parametrize(
    ("kind", "old", "new", "reason"),
    [
        ("sine", "kind: sine", "kind: square", "path.kind: must be one of sine, sweep, tap, slide, twist, random"),
        ("sine", "end_s: 1.2", "end_s: 0.2", "path.end_s: must be after start_s = 0.2, got 0.2"),
        ("sine", "end_s: 1.2", "end_s: 2.2", r"path.end_s: must be a number in \[0, 2\], got 2.2"),
        ("sine", "rise_s: 0.1", "rise_s: 0.6", r"path.rise_s: must be a number in \(0, 0.5\), got 0.6"),
        ("sine", "amplitude_N: 0.2", "amplitude_N: 0.6", r"path.amplitude_N: must be a number in \[0, 0.5\], got 0.6"),
        ("sine", "frequency_Hz: 200", "frequency_Hz: -1", "path.frequency_Hz: must be .*, got -1"),
        ("sine", "force_N: 0.5", "force_N: 500", r"path.force_N: must be a number in \[0, 66.6667\], got 500"),
        ("sine", "force_N: 0.5", "indentation_mm: 0.5", "path.amplitude_mm: missing"),
        ("sine", "x_mm: 1", "x_mm: 7", r"path.x_mm: must be a number in \[-3.75, 3.75\], got 7"),
        ("sweep", ", end_frequency_Hz: 300", "", "path.end_frequency_Hz: missing"),
        ("slide", "to_x_mm: 2", "to_x_mm: -4", r"path.to_x_mm: must be a number in \[-3.75, 3.75\], got -4"),
        ("slide", "strokes: 3", "strokes: 0", "path.strokes: must be a whole number in .*, got 0"),
        ("twist", "to_angle_deg: 90", "to_angle_deg: fast", "path.to_angle_deg: must be a number"),
        ("twist", "strokes: 2", "strokes: 2, speed: 1", "path.speed: unknown key"),
        ("random", "x_mm: 1", "x_mm: 3", r"path.x_mm: must be a number in \[-2.75, 2.75\], got 3"),
        ("random", "seed: 5", "seed: -5", "path.seed: must be a whole number"),
    ],
)
def test_an_invalid_path_is_rejected(tmp_path: Path, kind: str, old: str, new: str, reason: str) -> None:
    text = with_path(f"path: {{kind: {kind}, {TOUCH}, {PATHS[kind]}}}")
    assert old in text
    path = write(tmp_path, text.replace(old, new))
    with pytest.raises(ConfigError, match=rf"objects\[0\].{reason}") as caught:
        load_scene(path, SENSOR)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_taps_that_overlap_or_end_too_late_are_rejected(tmp_path: Path) -> None:
    assert load_scene(write(tmp_path, with_path(TAP)), SENSOR).constant_until(0.23) == pytest.approx(0.3)
    with pytest.raises(ConfigError, match=r"path.contact_s: must be a number in \[0.0001, 0.1\], got 0.2"):
        load_scene(write(tmp_path, with_path(TAP.replace("contact_s: 0.02", "contact_s: 0.2"))), SENSOR)
    with pytest.raises(ConfigError, match=r"path.count: must be in \[1, 18\] to end in time, got 19"):
        load_scene(write(tmp_path, with_path(TAP.replace("count: 5", "count: 19"))), SENSOR)
    load_scene(write(tmp_path, with_path(TAP.replace("count: 5", "count: 18"))), SENSOR)


def test_a_texture_driven_by_indentation_is_rejected(tmp_path: Path) -> None:
    pad = "kind: texture, profile: bumps, length_mm: 6, width_mm: 3, bumps: 9, seed: 4"
    frames = "keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, indentation_mm: 0}]"
    text = GOOD[: GOOD.index("  - name")] + f"  - {{name: it, {pad}, {frames}}}\n"
    with pytest.raises(ConfigError, match="indentation_mm: cannot drive a soft face"):
        load_scene(write(tmp_path, text), SENSOR)


def test_an_indentation_gives_the_hertz_force(tmp_path: Path) -> None:
    text = GOOD.replace("force_N: 0.0", "indentation_mm: -0.5").replace("force_N: 1.5", "indentation_mm: 0.4")
    scene = load_scene(write(tmp_path, text), SENSOR)
    (pressed,) = scene.states(1.0)
    assert pressed.force == pytest.approx(4 / 3 * 2e6 * math.sqrt(5e-3) * 0.4e-3**1.5, rel=1e-9)
    loads = SceneLoads(scene, SENSOR)
    assert loads.objects(0.0).positions[0, 2] == pytest.approx(5.5e-3, abs=1e-12)
    assert loads.objects(1.0).positions[0, 2] == pytest.approx(4.6e-3, abs=1e-12)
    assert not loads.forces([0.0])
    with pytest.raises(ConfigError, match=r"keyframes\[1\].indentation_mm: must be a number in \[-10, 5\], got 5.1"):
        load_scene(write(tmp_path, text.replace("indentation_mm: 0.4", "indentation_mm: 5.1")), SENSOR)


@pytest.mark.parametrize("name", SHIPPED)
def test_rest_intervals_of_a_scene_are_exact(name: str) -> None:
    scene = load_scene(name, SENSOR)

    def state(time: float) -> tuple[tuple[float, ...], ...]:
        local = scene.local_time(time)
        poses = [item.path.at(local) for item in scene.objects]
        return ((scene.chip_temperature(time),), *(pose if pose[-1] > 0 else (0.0,) for pose in poses))

    span = min(scene.period, 10.0)
    for time in np.linspace(0, 2 * span, 203):
        until = scene.constant_until(float(time))
        assert until >= time
        if until == time:
            assert any(state(time + step) != state(time) for step in (0.01, 0.0037, 0.0003))
        for later in np.linspace(time, min(until, time + 2 * span), 8):
            assert state(float(later) - 1e-9 * (later > time)) == state(time)
        if math.isfinite(until):
            assert any(state(until + step) != state(time) for step in (0.02, 0.01, 0.0037, 0.0005))


def test_two_fingers_stay_two_separate_contacts() -> None:
    loads = SceneLoads(load_scene("two_fingers", SENSOR), SENSOR)
    for time in np.linspace(0, 4, 81):
        forces = np.zeros((5, 5))
        for patch in loads.forces([float(time)]):
            forces[patch.rows, patch.cols] += patch.force[0]
        assert max(forces[2].max(), forces[:, 2].max()) < SENSOR.contact.threshold  # the separating row and column


def test_the_example_in_the_document_is_a_valid_scene(tmp_path: Path) -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", DOCUMENT, re.DOTALL)
    scene = load_scene(write(tmp_path, example), SENSOR)
    taps = [time for time in np.arange(0, 1, 0.01) if scene.objects[0].path.at(float(time))[-1] > 0.99]
    assert len(taps) == 3


@pytest.mark.parametrize("name", SHIPPED)
def test_the_document_names_each_shipped_scene(name: str) -> None:
    assert f"| `{name}`" in DOCUMENT


@pytest.mark.parametrize("kind", [*SHAPES, *PATHS, "tap"])
def test_the_document_names_each_kind(kind: str) -> None:
    assert f"`{kind}`" in DOCUMENT


def test_the_document_names_each_key() -> None:
    sources = "".join(
        Path(module.__file__).read_text(encoding="utf-8") for module in (scene_file, trajectory_file, pattern_file)
    )
    keys = set(re.findall(r"(?:\.\w+\(|_length\(section, |read_angle\(\w+, |keyframes\(\w+, )\"(\w+)\"", sources))
    assert len(keys) > 35
    assert not {key for key in keys if f"`{key}`" not in DOCUMENT}


def test_a_scene_has_a_limited_number_of_objects(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    keyframe = "{time_s: 0, x_mm: 0, y_mm: 0, force_N: 0}"
    item = f"  - {{name: o%d, kind: ring, outer_radius_mm: 3, inner_radius_mm: 1, keyframes: [{keyframe}]}}\n"
    head = "name: many\ndescription: many\ntemperature_degC: 25\nobjects:\n"
    path.write_text(head + "".join(item % index for index in range(65)), encoding="utf-8")
    with pytest.raises(ConfigError, match=f"^{path}: objects: must hold at most 64 objects, got 65$"):
        load_scene(path, load_sensor())
