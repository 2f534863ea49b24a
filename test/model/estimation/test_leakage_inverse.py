# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces from charges that leak: exact for forces that are linear within each step, whatever the steps are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.estimation.leakage_inverse import LeakageInverse

TAU = np.array([0.05, 0.3, 40.0])
PER_CHARGE = np.array([2e4, -1e5, 5e4])
NONE = np.zeros(3)
OFFSET = np.array([0.2, -0.1, 0.05])
"""Offsets in the signals [N]."""


def leaky_charge(forces: list[float], steps: list[float], offset: np.ndarray = NONE) -> np.ndarray:
    """Return charges [C/m2] of taxels that are pressed by forces [N], each linear in time; the first force is 0.

    Solves d(signal)/dt = d(force)/dt - signal/tau over each step; the offset does not leak.
    """
    signal, signals = np.zeros(3), []
    for before, after, step in zip([0.0, *forces[:-1]], forces, steps, strict=True):
        decay = np.array([math.exp(-step / tau) for tau in TAU])
        held = (after - before) / step * TAU  # the signal that a ramp for ever leads to
        signal = held + (signal - held) * decay
        signals.append(signal)
    return (np.array(signals) + offset) / PER_CHARGE


def recovered(inverse: LeakageInverse, charges: np.ndarray, steps: list[float]) -> np.ndarray:
    out, total, totals = np.empty(3), np.zeros(3), []
    for charge, step in zip(charges, steps, strict=True):
        inverse.advance(charge, step, out)
        total = total + out
        totals.append(total)
    return np.array(totals)


def started(offset: np.ndarray = NONE) -> LeakageInverse:
    inverse = LeakageInverse(TAU, PER_CHARGE)
    inverse.start(offset / PER_CHARGE)
    return inverse


@given(st.lists(st.tuples(st.floats(-1.0, 3.0), st.floats(1e-4, 0.3)), min_size=1, max_size=30))
def test_any_force_is_recovered_over_any_steps(history: list[tuple[float, float]]) -> None:
    forces, steps = [force for force, _ in history], [step for _, step in history]
    found = recovered(started(), leaky_charge(forces, steps), steps)
    np.testing.assert_allclose(found, np.tile(forces, (3, 1)).T, rtol=0, atol=1e-8)


def test_a_held_force_stays_long_after_its_charge_has_leaked() -> None:
    steps = [1e-3] * 3000
    charges = leaky_charge([2.0] * 3000, steps)
    assert charges[-1, 0] * PER_CHARGE[0] == pytest.approx(0.0, abs=1e-12)
    assert recovered(started(), charges, steps)[-1] == pytest.approx(2.0, abs=1e-9)


def test_an_offset_drifts_by_its_share_of_the_time_constant() -> None:
    steps = [2e-3] * 500
    found = recovered(started(OFFSET), leaky_charge([0.0] * 500, steps, OFFSET), steps)
    assert found[-1] == pytest.approx(OFFSET * 1.0 / TAU, rel=1e-9)


def test_more_different_steps_than_are_kept_are_still_exact() -> None:
    steps = [1e-3 + 1e-5 * (number % 100) for number in range(300)]
    assert len(set(steps)) > LeakageInverse.CACHE_SIZE
    forces = [math.sin(0.1 * number) for number in range(300)]
    found = recovered(started(), leaky_charge(forces, steps), steps)
    np.testing.assert_allclose(found[:, 1], forces, rtol=0, atol=1e-10)


def test_the_signal_is_the_charge_of_the_last_scan_as_a_force() -> None:
    inverse = started(OFFSET)
    assert inverse.signal == pytest.approx(OFFSET)
    inverse.advance(np.array([1e-5, 1e-6, -2e-5]), 1e-3, np.empty(3))
    assert inverse.signal == pytest.approx([0.2, -0.1, -1.0])


def test_the_share_of_the_step_is_returned() -> None:
    assert started().advance(np.zeros(3), 0.03, np.empty(3)).ratio == pytest.approx([0.6, 0.1, 0.00075])
