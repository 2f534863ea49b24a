# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The environment of a grasp: gymnasium's checks, reproducibility, observations against the truth, and what pays."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="needs gymnasium")

from gymnasium.utils.env_checker import check_env

import posfet.gym
from posfet_sim.grasp.environment import DROP_COST, DURATION, STEP, GraspEnv
from posfet_sim.grasp.mechanics import GraspMechanics, Gripper

Policy = Callable[[dict[str, Any]], float]


SOON = {"lift_time": 0.5, "growth_time": 0.9}
"""Early times of what happens to the object, and a whole episode that is short."""
STEPS = 150


def episode(policy: Policy, seed: int) -> tuple[float, bool, dict[str, Any]]:
    """Return the sum of the rewards, whether the object was lost, and the last info."""
    environment = GraspEnv()
    observation, info = environment.reset(seed=seed, options=SOON)
    total, lost = 0.0, False
    for _ in range(STEPS):
        observation, reward, lost, _, info = environment.step(np.array([policy(observation)], np.float32))
        total += reward
        if lost:
            break
    return total, lost, info


class GripOnSlip:
    """Grips lightly, and more firmly for a while whenever a contact slips or moves."""

    def __init__(self) -> None:
        self.steps_left = 0

    def __call__(self, observation: dict[str, Any]) -> float:
        contact = observation["contact"]
        if observation["time"][0] > SOON["lift_time"] and (contact[:, 4].any() or np.abs(contact[:, 3]).max() > 1.5e-3):
            self.steps_left = 8
        if self.steps_left:
            self.steps_left -= 1
            return 1.0
        return float(contact[:, 0].min() < 0.5)


def test_gymnasium_accepts_the_environment() -> None:
    environment = gymnasium.make(posfet.gym.ENVIRONMENT, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped)
    environment.close()


def test_control_of_the_width_has_observations_of_its_space() -> None:
    environment = GraspEnv("width")
    observation, _ = environment.reset(seed=5)
    assert environment.observation_space.contains(observation)
    for _ in range(12):
        observation, _, _, _, info = environment.step(np.ones(1, np.float32))
        assert environment.observation_space.contains(observation)
    assert observation["command"][0] == pytest.approx(12 * 0.2e-3)
    assert info["grip_force"] > 0.5


def test_an_episode_ends_with_its_time() -> None:
    environment = GraspEnv()
    environment.reset(seed=1)
    environment._mechanics.time = DURATION - 1.5 * STEP
    assert [environment.step(np.zeros(1, np.float32))[3] for _ in range(2)] == [False, True]


def test_the_same_seed_gives_the_same_episode() -> None:
    runs = []
    for seed in (7, 7, 8):
        environment = GraspEnv()
        observation, _ = environment.reset(seed=seed)
        environment.action_space.seed(seed)
        runs.append([observation, *(environment.step(environment.action_space.sample())[0] for _ in range(5))])
    for first, second in zip(runs[0], runs[1], strict=True):
        for name, array in first.items():
            np.testing.assert_array_equal(array, second[name])
    assert not np.array_equal(runs[0][-1]["force"], runs[2][-1]["force"])


def test_observations_agree_with_the_truth() -> None:
    environment = GraspEnv()
    observation, _ = environment.reset(seed=3, options={"mass": 0.05, "static_friction": 1.0, "lift_time": 0.3})
    assert observation["valid"].all()
    assert not observation["contact"].any()
    for _ in range(45):
        observation, reward, _, _, info = environment.step(np.array([0.5], np.float32))
    assert info["mass"] == 0.05
    np.testing.assert_allclose(observation["contact"][:, 0], info["grip_force"], rtol=0.15)
    np.testing.assert_allclose(observation["force"].sum(axis=(1, 2)), info["grip_force"], rtol=0.15)
    assert info["load"] > 0.0
    assert info["slip"] == 0.0
    assert reward == pytest.approx(1.0 - 0.5 * info["grip_force"] / 4.0)
    assert observation["time"][0] == pytest.approx(0.45)


def test_an_object_that_is_not_gripped_is_lost() -> None:
    total, lost, info = episode(lambda _: 0.0, seed=1)
    assert lost
    assert info["slip"] >= 3e-3
    assert total < -DROP_COST


def firm(seed: int) -> float:
    """Return the rewards of the largest grip force from 0.3 s on; needs no touch."""
    environment = GraspEnv(imperfections="none")
    environment.reset(seed=seed, options=SOON)
    mechanics = GraspMechanics(replace(environment._mechanics.grasped), Gripper())
    total = 0.0
    for _ in range(STEPS):
        mechanics.move(float(mechanics.time > 0.3), STEP)
        for _ in range(10):
            mechanics.step(STEP / 10)
        assert mechanics.slip == 0.0
        total += mechanics.lifted - 0.5 * mechanics.force / 4.0
    return total


@pytest.mark.slow
def test_feeling_the_slip_pays() -> None:
    """A touch that is felt holds the object with less force than a blind firm grip."""
    total, lost, info = episode(GripOnSlip(), seed=1)
    assert not lost
    assert info["grip_force"] < 2.0
    assert total > firm(1) + 30.0


def test_rendering_is_a_picture_of_both_fingertips() -> None:
    environment = GraspEnv(render_mode="rgb_array")
    environment.reset(seed=1)
    dark = environment.render()
    for _ in range(40):
        environment.step(np.array([1.0], np.float32))
    bright = environment.render()
    assert dark is not None
    assert bright is not None
    assert bright.shape == dark.shape == (160, 336, 3)
    assert bright.dtype == np.uint8
    assert bright.max() > dark.max()
    assert GraspEnv().render() is None


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: GraspEnv("torque"), r"^control must be force or width, got 'torque'$"),
        (lambda: GraspEnv(render_mode="human"), r"^render_mode must be None or rgb_array, got 'human'$"),
        (lambda: GraspEnv(sensor="posfet_6x6"), r"^posfet_6x6: no such sensor"),
        (lambda: GraspEnv().reset(options={"weight": 1.0}), r"^options: weight must be one of mass, static_friction"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(make: Callable[[], object], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        make()


def test_a_step_before_a_reset_is_refused() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        GraspEnv().step(np.zeros(1, np.float32))
