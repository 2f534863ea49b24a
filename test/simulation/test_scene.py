"""Scenes: what is read is what happens, and what cannot be is refused in one line."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_driver.contact_pressure import SphereOnArray
from posfet_driver.scene import SCENE_FOLDER, Scene, Sphere, Track, greatest_force, load_scene
from posfet_model.config import ConfigError
from posfet_model.sensor import load_sensor

SENSOR = load_sensor()
DOCUMENT = (Path(__file__).resolve().parents[2] / "docs" / "scenes.md").read_text(encoding="utf-8")
SHIPPED = sorted(path.stem for path in SCENE_FOLDER.glob("*.yaml"))

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
            Sphere(
                name="ball",
                radius=5e-3,
                effective_modulus=2e6,
                path=Track((0.5, 1.0, 1.5), ((1e-3, -2e-3, 0.0), (1e-3, -2e-3, 1.5), (-1e-3, 2e-3, 0.0))),
            ),
        ),
        temperature=Track((0.0,), ((25.0,),)),
    )
    assert scene == expected


def test_temperature_by_keyframes_and_no_period(tmp_path: Path) -> None:
    text = GOOD.replace("temperature_degC: 25.0\n", RAMP).replace("period_s: 2.0\n", "")
    scene = load_scene(write(tmp_path, text), SENSOR)
    assert math.isinf(scene.period)
    assert scene.temperature.at(0.5) == (25.0,)
    assert scene.local_time(1e5) == 1e5


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes(name: str) -> None:
    scene = load_scene(name, SENSOR)
    assert scene.name == name
    for item in scene.objects:
        forces = [values[-1] for values in item.path.values]
        assert 0.5 <= max(forces) <= 2.0
        assert item.path.at(0.3)[-1] == 0
        assert scene.rests_until(0.0) == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("name: good\n", "", "name: missing, must be text"),
        ("name: good", "name: 3", "name: must be text, got 3"),
        ("name: good", "name: good\nspeed: 2", "speed: unknown key"),
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
        ("    kind: sphere\n", "", r"objects\[0\].kind: missing, must be one of sphere"),
        ("kind: sphere", "kind: cube", r"objects\[0\].kind: must be one of sphere, got 'cube'"),
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
        (GOOD[GOOD.index("      - {") :], "      []\n", "keyframes: must hold at least one keyframe"),
        (GOOD[GOOD.index("      - {") :], "      3\n", "keyframes: must be a list of mappings"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path: Path, old: str, new: str, reason: str) -> None:
    assert old in GOOD
    path = write(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ConfigError, match=reason) as caught:
        load_scene(path, SENSOR)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message


def test_two_objects_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"objects\[1\].name: must differ .*, got 'ball'"):
        load_scene(write(tmp_path, GOOD + SECOND), SENSOR)


def test_an_unknown_name_is_told_the_shipped_ones() -> None:
    with pytest.raises(ConfigError, match=r"no_such: no such scene; .* hold, idle, press_slide_lift, two_fingers"):
        load_scene("no_such", SENSOR)


def test_a_force_above_the_range_of_a_taxel_is_refused_by_the_taxel(tmp_path: Path) -> None:
    hard = GOOD.replace("effective_modulus_MPa: 2.0", "effective_modulus_MPa: 200.0")
    limit = greatest_force(SENSOR, 5e-3, 200e6)
    forces = np.zeros((5, 5))
    SphereOnArray(SENSOR.layout, SENSOR.device.contact_spread, 5e-3, 200e6).add(forces, 0.0, 0.0, limit)
    assert forces.max() == pytest.approx(SENSOR.device.force_max, rel=1e-5)
    load_scene(write(tmp_path, hard.replace("force_N: 1.5", f"force_N: {limit * 0.999}")), SENSOR)
    with pytest.raises(ConfigError, match=r"force_N: must be a number in \[0, "):
        load_scene(write(tmp_path, hard.replace("force_N: 1.5", f"force_N: {limit * 1.001}")), SENSOR)
    weaker = replace(SENSOR, device=replace(SENSOR.device, force_max=SENSOR.device.force_max / 2))
    assert greatest_force(weaker, 5e-3, 200e6) < limit


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(0, 5)), min_size=1, max_size=6), st.floats(-1, 7))
def test_a_track_stays_between_its_keyframes(values: list[tuple[float, float]], time: float) -> None:
    track = Track(tuple(float(k) for k in range(len(values))), tuple(values))
    before = values[min(max(math.floor(time), 0), len(values) - 1)]
    after = values[min(max(math.floor(time) + 1, 0), len(values) - 1)]
    for value, a, b in zip(track.at(time), before, after, strict=True):
        assert min(a, b) - 1e-15 <= value <= max(a, b) + 1e-15


def test_a_track_is_the_path_of_least_jerk() -> None:
    track = Track((1.0, 3.0), ((0.0,), (2.0,)))
    u = np.linspace(0, 1, 41)
    expected = 2 * (10 * u**3 - 15 * u**4 + 6 * u**5)
    np.testing.assert_allclose([track.at(1 + 2 * s)[0] for s in u], expected, rtol=0, atol=1e-14)
    for end in (1.0, 3.0):  # at rest, and without a jump of acceleration: the change is of third order
        for step in (1e-3, -1e-3):
            assert abs(track.at(end + step)[0] - track.at(end)[0]) <= 2 * 10 * (1e-3 / 2) ** 3


@pytest.mark.parametrize("name", SHIPPED)
def test_a_scene_rests_exactly_as_long_as_nothing_changes(name: str) -> None:
    scene = load_scene(name, SENSOR)

    def state(time: float) -> tuple[tuple[float, ...], ...]:
        local = scene.local_time(time)
        poses = [item.path.at(local) for item in scene.objects]
        return (scene.temperature.at(local), *(pose if pose[-1] > 0 else (0.0,) for pose in poses))

    span = scene.period if math.isfinite(scene.period) else 10.0
    for time in np.linspace(0, 2 * span, 403):
        until = scene.rests_until(float(time))
        assert until >= time
        if until == time:
            assert state(time + 0.01) != state(time)
        for later in np.linspace(time, min(until, time + 2 * span), 20):
            assert state(float(later) - 1e-9 * (later > time)) == state(time)
        if math.isfinite(until):
            assert state(until + 0.02) != state(time)


def test_the_two_fingers_stay_two_contacts() -> None:
    scene = load_scene("two_fingers", SENSOR)
    for time in np.linspace(0, scene.period, 81):
        forces = np.zeros((5, 5))
        for item in scene.objects:
            sphere = SphereOnArray(SENSOR.layout, SENSOR.device.contact_spread, item.radius, item.effective_modulus)
            sphere.add(forces, *item.path.at(float(time)))
        assert max(forces[2].max(), forces[:, 2].max()) < SENSOR.contact.threshold  # the cross between them


def test_the_example_of_the_document_is_a_scene(tmp_path: Path) -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", DOCUMENT, re.DOTALL)
    scene = load_scene(write(tmp_path, example), SENSOR)
    taps = [time for time in np.arange(0, 1, 0.01) if scene.objects[0].path.at(float(time))[-1] > 0.99]
    assert len(taps) == 3


@pytest.mark.parametrize("name", SHIPPED)
def test_the_document_names_each_shipped_scene(name: str) -> None:
    assert f"| `{name}`" in DOCUMENT


def test_a_force_that_ends_at_zero_never_falls_below_it() -> None:
    track = Track(times=(2.6, 2.9), values=((1.8,), (0.0,)))
    below_the_end = np.nextafter(2.9, 0.0) - np.arange(20_000) * 1e-9
    assert min(track.at(float(time))[0] for time in below_the_end) >= 0.0
