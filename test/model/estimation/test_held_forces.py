# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Weak forces beside strong ones, while an object rests."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from posfet_core.scan_path import HELD_PLAY, HELD_TIME, HeldForces
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.grid import compiled_layout
from reference.estimation.held_forces import HeldForces as Reference

LAYOUT = replace(load_sensor().layout, rows=3, cols=4)
BLOCK = 0.02
STRONG, WEAK, FAR = 5, 6, 3
BLOCKS = round(1.5 * HELD_TIME / BLOCK)


def pressed(strong: float, weak: float) -> NDArray[np.float64]:
    force = np.zeros(LAYOUT.taxels)
    force[STRONG], force[WEAK] = strong, weak
    return force


def after(*forces: NDArray[np.float64], certain: bool = True) -> NDArray[np.float64]:
    """Return what is held after each force has rested."""
    held_forces, flags = HeldForces(compiled_layout(LAYOUT)), np.zeros(LAYOUT.taxels, np.bool_)
    for force in forces:
        flags[STRONG] = certain and force[STRONG] > 0.0
        for _ in range(BLOCKS):
            held_forces.update(force, flags, BLOCK)
    return held_forces.held


def test_a_weak_force_that_seems_to_fade_beside_a_strong_one_that_rests_is_held() -> None:
    held = after(pressed(0.3, 0.04), pressed(0.3, 0.02), pressed(0.3, 0.0))
    np.testing.assert_allclose(held[WEAK], 0.04, rtol=1e-12)
    assert held[FAR] == 0.0


def test_a_weak_force_is_held_while_the_strong_one_trembles() -> None:
    held = after(pressed(0.3, 0.04), pressed(0.3 * (1.0 - 0.9 * HELD_PLAY), 0.0))
    np.testing.assert_allclose(held[WEAK], 0.04, rtol=1e-12)


def test_nothing_is_held_when_the_strong_force_has_gone() -> None:
    assert not after(pressed(0.3, 0.04), pressed(0.0, 0.03)).any()


def test_nothing_is_held_while_the_strong_force_moves() -> None:
    moving = [pressed(0.3 * 0.8**step, 0.04) for step in range(5)]
    held_forces, flags = HeldForces(compiled_layout(LAYOUT)), np.zeros(LAYOUT.taxels, np.bool_)
    flags[STRONG] = True
    for force in moving:
        held_forces.update(force, flags, BLOCK)
        assert not held_forces.held.any()


def test_nothing_is_held_beside_a_force_that_may_be_none() -> None:
    assert not after(pressed(0.3, 0.04), pressed(0.3, 0.0), certain=False).any()


def test_what_is_held_is_the_force_at_the_last_motion() -> None:
    held = after(pressed(0.3, 0.04), pressed(0.5, 0.01), pressed(0.5, 0.0))
    np.testing.assert_allclose(held[WEAK], 0.01, rtol=1e-12)


def test_compiled_held_forces_are_those_of_the_reference() -> None:
    random, compiled, reference = np.random.default_rng(1), HeldForces(compiled_layout(LAYOUT)), Reference(LAYOUT)
    force, any_held = np.abs(random.standard_normal(LAYOUT.taxels)), False
    for _ in range(400):
        force = np.where(random.random(LAYOUT.taxels) < 0.02, np.abs(random.standard_normal(LAYOUT.taxels)), force)
        certain = force > 0.5
        compiled.update(force, certain, BLOCK)
        reference.update(force, certain, BLOCK)
        np.testing.assert_array_equal(compiled.held, reference.held)
        any_held |= bool(compiled.held.any())
    assert any_held
