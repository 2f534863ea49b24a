# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Paths of objects from YAML: what is read, and what is refused in one line."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import yaml

from posfet_model.config import ConfigError, Section
from posfet_sim.scene.keyframes import Keyframes, Path
from posfet_sim.scene.path_file import read_path
from posfet_sim.scene.trajectories import RandomMotion, Stroke, Taps, Vibration
from posfet_sim.scene.trajectory_file import Limits, keyframe_time, keyframes

LIMITS = Limits(half_x=5e-3, half_y=4e-3, force=3.0, indentation=1e-3, period=math.inf)
PRESS = "start_s: 1, end_s: 5, rise_s: 0.5, x_mm: 1, y_mm: -2, force_N: 2"


def read(text: str, limits: Limits = LIMITS) -> tuple[Path, bool]:
    section = Section("scene.yaml", "objects[0]", yaml.safe_load(text))
    found = read_path(section, limits)
    section.end()
    return found


def path_of(kind: str, more: str = "", limits: Limits = LIMITS) -> Path:
    found, by_indentation = read(f"path: {{kind: {kind}, {PRESS}{more}}}", limits)
    assert not by_indentation
    return found


def test_keyframes_are_read_in_metres_and_radians() -> None:
    found, by_indentation = read(
        "keyframes: [{time_s: 0.5, x_mm: 1, y_mm: -2, force_N: 0}, "
        "{time_s: 2, x_mm: -5, y_mm: 4, angle_deg: 90, force_N: 3}]"
    )
    assert isinstance(found, Keyframes)
    assert not by_indentation
    assert found.at(0.0) == pytest.approx((1e-3, -2e-3, 0.0, 0.0))
    assert found.at(9.0) == pytest.approx((-5e-3, 4e-3, math.pi / 2, 3.0))
    assert found.at(1.25) == pytest.approx((-2e-3, 1e-3, math.pi / 4, 1.5))  # half way
    assert found.max_load() == 3.0


def test_keyframes_of_indentations_may_begin_above_the_surface() -> None:
    found, by_indentation = read(
        "keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, indentation_mm: -10}, "
        "{time_s: 1, x_mm: 0, y_mm: 0, indentation_mm: 1}]"
    )
    assert by_indentation
    assert [found.at(time)[-1] for time in (0.0, 1.0)] == pytest.approx([-10e-3, 1e-3])


def test_a_vibration_has_one_frequency_and_a_sweep_two() -> None:
    sine = path_of("sine", ", frequency_Hz: 40, amplitude_N: 0.5, angle_deg: -45")
    sweep = path_of("sweep", ", frequency_Hz: 40, end_frequency_Hz: 80, amplitude_N: 0.5")
    assert isinstance(sine, Vibration)
    assert isinstance(sweep, Vibration)
    assert (sine.frequency, sine.end_frequency, sine.amplitude) == (40.0, 40.0, 0.5)
    assert (sweep.frequency, sweep.end_frequency) == (40.0, 80.0)
    assert sine.angle == pytest.approx(-math.pi / 4)
    assert sine.max_load() == pytest.approx(2.5)
    assert sine.at(0.9)[-1] == sine.at(5.1)[-1] == 0.0


def test_a_slide_ends_elsewhere_and_a_twist_at_another_angle() -> None:
    slide = path_of("slide", ", to_x_mm: -1, to_y_mm: 2, angle_deg: 30")
    twist = path_of("twist", ", to_angle_deg: 180, strokes: 3")
    assert isinstance(slide, Stroke)
    assert isinstance(twist, Stroke)
    assert (slide.to_x, slide.to_y, slide.strokes) == (pytest.approx(-1e-3), pytest.approx(2e-3), 1)
    assert slide.at(4.5) == pytest.approx((-1e-3, 2e-3, math.pi / 6, 2.0))
    assert twist.at(4.5) == pytest.approx((1e-3, -2e-3, math.pi, 2.0))
    assert twist.strokes == 3


def test_taps_repeat() -> None:
    found, _ = read(
        "path: {kind: tap, start_s: 1, interval_s: 0.5, contact_s: 0.2, count: 3, x_mm: 0, y_mm: 0, force_N: 1}"
    )
    assert isinstance(found, Taps)
    assert [found.at(time)[-1] for time in (1.1, 1.6, 2.1)] == pytest.approx([1.0] * 3)
    assert [found.at(time)[-1] for time in (0.9, 1.3, 2.3, 2.6)] == [0.0] * 4


def test_random_motion_stays_within_its_reach() -> None:
    found = path_of("random", ", reach_mm: 2, amplitude_N: 1, bandwidth_Hz: 5, seed: 7")
    assert isinstance(found, RandomMotion)
    poses = [found.at(1.5 + 0.01 * number) for number in range(300)]
    assert max(math.hypot(x - 1e-3, y + 2e-3) for x, y, _, _ in poses) <= 2e-3 * math.sqrt(2)
    assert all(1.0 <= load <= 3.0 for *_, load in poses)
    again = path_of("random", ", reach_mm: 2, amplitude_N: 1, bandwidth_Hz: 5, seed: 7")
    assert again.at(2.0) == found.at(2.0)


def test_a_path_may_be_driven_by_indentation() -> None:
    found, by_indentation = read(
        "path: {kind: sine, start_s: 0, end_s: 2, rise_s: 0.5, x_mm: 0, y_mm: 0, indentation_mm: 0.6, "
        "frequency_Hz: 10, amplitude_mm: 0.4}"
    )
    assert by_indentation
    assert found.max_load() == pytest.approx(1e-3)


KEYFRAME = "{time_s: 1, x_mm: 0, y_mm: 0, force_N: 1}"
REFUSED: dict[str, tuple[str, str]] = {
    "neither": ("{}", "objects[0].keyframes: missing"),
    "both": (f"{{path: {{kind: sine}}, keyframes: [{KEYFRAME}]}}", "keyframes: must not be given together with path"),
    "no keyframe": ("keyframes: []", "objects[0].keyframes: must hold at least one keyframe, got none"),
    "same time": (f"keyframes: [{KEYFRAME}, {KEYFRAME}]", "keyframes[1].time_s: must be after 1, the keyframe before"),
    "outside": ("keyframes: [{time_s: 0, x_mm: 5.1, y_mm: 0, force_N: 0}]", "x_mm: must be a number in [-5, 5]"),
    "too strong": ("keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, force_N: 3.1}]", "force_N: must be a number in [0, 3]"),
    "pulls": ("keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, force_N: -0.1}]", "force_N: must be a number in [0, 3]"),
    "unknown key": ("keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, force_N: 0, speed: 1}]", "speed: unknown key"),
    "mixed loads": (
        f"keyframes: [{KEYFRAME}, {{time_s: 2, x_mm: 0, y_mm: 0, indentation_mm: 1}}]",
        "keyframes[1].force_N: missing",
    ),
    "unknown kind": ("path: {kind: circle}", "path.kind: must be one of sine, sweep, tap, slide, twist, random"),
    "ends first": (
        "path: {kind: twist, start_s: 2, end_s: 2, rise_s: 1, x_mm: 0, y_mm: 0, force_N: 1, to_angle_deg: 1}",
        "path.end_s: must be after start_s = 2, got 2",
    ),
    "rises too long": (
        "path: {kind: twist, start_s: 0, end_s: 2, rise_s: 1.1, x_mm: 0, y_mm: 0, force_N: 1, to_angle_deg: 1}",
        "path.rise_s: must be a number in (0, 1)",
    ),
    "leaves the surface": (
        f"path: {{kind: sine, {PRESS}, frequency_Hz: 1, amplitude_N: 1.1}}",
        "path.amplitude_N: must be a number in [0, 1]",
    ),
    "reaches outside": (
        "path: {kind: random, start_s: 0, end_s: 2, rise_s: 0.5, x_mm: 3.1, y_mm: 0, force_N: 1, reach_mm: 2, "
        "amplitude_N: 0, bandwidth_Hz: 1, seed: 1}",
        "path.x_mm: must be a number in [-3, 3]",
    ),
    "key of another path": (f"path: {{kind: twist, {PRESS}, to_angle_deg: 1, seed: 1}}", "path.seed: unknown key"),
    "taps overlap": (
        "path: {kind: tap, start_s: 0, interval_s: 0.1, contact_s: 0.2, count: 1, x_mm: 0, y_mm: 0, force_N: 1}",
        "path.contact_s: must be a number in [0.0001, 0.1]",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(case: str) -> None:
    text, message = REFUSED[case]
    with pytest.raises(ConfigError) as error:
        read(text)
    assert message in str(error.value)
    assert str(error.value).startswith("scene.yaml: objects[0]")
    assert "\n" not in str(error.value)


def test_a_texture_has_no_indentation() -> None:
    with pytest.raises(ConfigError, match="indentation_mm: cannot drive a soft face, which must be given force_N"):
        read("keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, indentation_mm: 0}]", replace(LIMITS, indentation=None))


PERIODIC = replace(LIMITS, period=2.0)


@pytest.mark.parametrize(
    ("last", "good"),
    [
        ("x_mm: 0, y_mm: 0, force_N: 1", True),
        ("x_mm: 0, y_mm: 0, force_N: 0", False),
        ("x_mm: 1, y_mm: 0, force_N: 1", False),
    ],
)
def test_a_scene_that_repeats_ends_as_it_begins_or_without_contact(last: str, good: bool) -> None:
    text = f"keyframes: [{{time_s: 0, x_mm: 0, y_mm: 0, force_N: 1}}, {{time_s: 2, {last}}}]"
    if good:
        assert read(text, PERIODIC)[0].at(2.0)[-1] == 1.0
        return
    with pytest.raises(ConfigError, match="a scene with a period_s must end without contact"):
        read(text, PERIODIC)


def test_without_contact_at_both_ends_the_object_may_be_elsewhere() -> None:
    text = "keyframes: [{time_s: 0, x_mm: 0, y_mm: 0, force_N: 0}, {time_s: 2, x_mm: 1, y_mm: 0, force_N: 0}]"
    assert read(text, PERIODIC)[0].at(2.0)[0] == pytest.approx(1e-3)


@pytest.mark.parametrize(("count", "good"), [(3, True), (4, False)])
def test_the_last_tap_ends_within_the_period(count: int, good: bool) -> None:
    text = (
        f"path: {{kind: tap, start_s: 0.5, interval_s: 0.5, contact_s: 0.25, count: {count}, x_mm: 0, y_mm: 0, "
        "force_N: 1}"
    )
    if good:
        assert isinstance(read(text, PERIODIC)[0], Taps)
        return
    with pytest.raises(ConfigError, match=r"count: must be in \[1, 3\] to end in time, got 4"):
        read(text, PERIODIC)


@pytest.mark.parametrize(("time", "good"), [(0.5, True), (2.0, True), (0.4, False), (2.1, False), (-1.0, False)])
def test_the_time_of_a_keyframe_is_after_the_one_before_and_within_the_period(time: float, good: bool) -> None:
    values: dict[str, Any] = {"keyframes": [{"time_s": time}]}
    (section,) = keyframes(Section("scene.yaml", "", values), "keyframes")
    if good:
        assert keyframe_time(section, [0.2, 0.4], 2.0) == time
        return
    with pytest.raises(ConfigError, match="time_s"):
        keyframe_time(section, [0.2, 0.4], 2.0)


def test_a_position_keeps_its_margin() -> None:
    section = Section("scene.yaml", "", {"from_x_mm": 3.0, "from_y_mm": -2.0})
    assert LIMITS.read_position(section, "from_", 2e-3) == pytest.approx((3e-3, -2e-3))
    with pytest.raises(ConfigError, match=r"y_mm: must be a number in \[-2, 2\]"):
        LIMITS.read_position(Section("scene.yaml", "", {"x_mm": 3.0, "y_mm": -2.1}), margin=2e-3)
