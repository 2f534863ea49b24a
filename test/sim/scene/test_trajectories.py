# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Trajectories: their values over time, and that nothing changes in their rest intervals."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_sim.scene.keyframes import Keyframes, Path
from posfet_sim.scene.trajectories import PressRelease, RandomMotion, Stroke, Taps, Vibration

TOUCH = {"start": 0.2, "end": 1.2, "rise": 0.1, "x": 1e-3, "y": -1e-3, "angle": 0.5, "load": 0.5}
PATHS: list[Path] = [
    PressRelease(**TOUCH),
    Vibration(**TOUCH, amplitude=0.2, frequency=200, end_frequency=200),
    Vibration(**TOUCH, amplitude=0.5, frequency=5, end_frequency=300),
    Stroke(**TOUCH, to_x=2e-3, to_y=2e-3, to_angle=1.5, strokes=3),
    RandomMotion(**TOUCH, amplitude=0.5, reach=1e-3, bandwidth=30.0, seed=5),
    Taps(start=0.2, contact=0.02, interval=0.1, count=5, x=1e-3, y=-1e-3, angle=0.0, load=0.5),
]


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(0, 5)), min_size=1, max_size=6), st.floats(-1, 7))
def test_an_interpolated_path_stays_between_its_keyframes(values: list[tuple[float, float]], time: float) -> None:
    track = Keyframes(tuple(float(k) for k in range(len(values))), tuple(values))
    before = values[min(max(math.floor(time), 0), len(values) - 1)]
    after = values[min(max(math.floor(time) + 1, 0), len(values) - 1)]
    for value, a, b in zip(track.at(time), before, after, strict=True):
        assert min(a, b) - 1e-15 <= value <= max(a, b) + 1e-15


def test_interpolation_between_keyframes_is_minimum_jerk() -> None:
    track = Keyframes((1.0, 3.0), ((0.0,), (2.0,)))
    u = np.linspace(0, 1, 41)
    expected = 2 * (10 * u**3 - 15 * u**4 + 6 * u**5)
    np.testing.assert_allclose([track.at(1 + 2 * s)[0] for s in u], expected, rtol=0, atol=1e-14)
    for end in (1.0, 3.0):  # at rest, with continuous acceleration: the change is of third order
        for step in (1e-3, -1e-3):
            assert abs(track.at(end + step)[0] - track.at(end)[0]) <= 2 * 10 * (1e-3 / 2) ** 3


def test_a_force_that_ends_at_zero_is_never_negative() -> None:
    track = Keyframes(times=(2.6, 2.9), values=((1.8,), (0.0,)))
    below_the_end = np.nextafter(2.9, 0.0) - np.arange(20_000) * 1e-9
    assert min(track.at(float(time))[0] for time in below_the_end) >= 0.0


@pytest.mark.parametrize("path", PATHS, ids=lambda path: type(path).__name__)
@given(time=st.floats(-1, 3))
def test_a_load_stays_within_its_range_and_is_zero_at_rest(path: Path, time: float) -> None:
    load = path.at(time)[-1]
    assert 0 <= load <= path.max_load() * (1 + 1e-12)
    if not any(start < time < end for start, end in path.changes()):
        assert load == 0


def test_a_tap_ends_when_it_says_so() -> None:
    [taps] = [path for path in PATHS if isinstance(path, Taps)]
    for begin, end in taps.changes():
        assert taps.at(begin)[-1] == taps.at(end)[-1] == 0.0


@pytest.mark.parametrize("path", PATHS, ids=lambda path: type(path).__name__)
def test_a_load_is_continuous(path: Path) -> None:
    loads = np.array([path.at(time)[-1] for time in np.arange(0, 1.5, 1e-5).tolist()])
    assert np.abs(np.diff(loads)).max() < 0.02


def test_a_sine_and_a_sweep_have_their_frequencies() -> None:
    times = np.arange(0.3, 1.1, 1e-5)
    for path, at_start, at_end in ((PATHS[1], 200, 200), (PATHS[2], 34.5, 270.5)):
        wave = np.array([path.at(time)[-1] for time in times.tolist()]) - 0.5
        crossings = times[1:][(wave[:-1] < 0) & (wave[1:] >= 0)]
        assert 1 / (crossings[1] - crossings[0]) == pytest.approx(at_start, rel=0.25)
        assert 1 / (crossings[-1] - crossings[-2]) == pytest.approx(at_end, rel=0.02)


def test_a_stroke_moves_back_and_forth_at_constant_speed() -> None:
    stroke = Stroke(**TOUCH, to_x=2e-3, to_y=2e-3, to_angle=1.5, strokes=3)
    np.testing.assert_allclose(stroke.at(0.3), (1e-3, -1e-3, 0.5, 0.5), atol=1e-12)
    duration = 0.8 / 3
    np.testing.assert_allclose(stroke.at(0.3 + duration), (2e-3, 2e-3, 1.5, 0.5), atol=1e-12)
    np.testing.assert_allclose(stroke.at(0.3 + 1.5 * duration), (1.5e-3, 0.5e-3, 1.0, 0.5), atol=1e-12)
    np.testing.assert_allclose(stroke.at(0.3 + 2 * duration), (1e-3, -1e-3, 0.5, 0.5), atol=1e-12)
    for time in (1.1, 1.15, 1.2, 7.0):
        np.testing.assert_allclose(stroke.at(time)[:3], (2e-3, 2e-3, 1.5), atol=1e-12)


def test_taps_start_at_their_times() -> None:
    taps = PATHS[-1]
    loads = [taps.at(0.2 + 0.1 * number + 0.01)[-1] for number in range(-1, 6)]
    np.testing.assert_allclose(loads, [0, 0.5, 0.5, 0.5, 0.5, 0.5, 0], atol=1e-12)
    assert len(taps.changes()) == 5


def test_random_motion_depends_on_the_seed_and_stays_in_range() -> None:
    first, same = (RandomMotion(**TOUCH, amplitude=0.5, reach=1e-3, bandwidth=30.0, seed=5) for _ in range(2))
    other = RandomMotion(**TOUCH, amplitude=0.5, reach=1e-3, bandwidth=30.0, seed=6)
    times = np.arange(0.3, 1.1, 1e-3).tolist()
    values = np.array([first.at(time) for time in times])
    np.testing.assert_array_equal(values, [same.at(time) for time in times])
    assert not np.allclose(values, [other.at(time) for time in times])
    assert np.abs(values[:, :2] - [1e-3, -1e-3]).max() <= 1e-3
    assert 0.1 < values[:, 3].std() / 0.5 < 0.4
    rising = np.flatnonzero(np.diff(np.sign(np.diff(values[:, 3]))))
    assert len(rising) < 2 * 30 * 0.8 + 2  # no faster than the bandwidth
