# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces from charges that leak: exact for forces that are linear within each step, whatever the steps are."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_core.scan_path import ForceIntegration
from reference import force_integration
from support.example_counts import each_of, examples

TAU = np.array([0.05, 0.3, 40.0])
PER_CHARGE = np.array([2e4, -1e5, 5e4])
NONE = np.zeros(3)
MILLISECOND = 1e-3
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


def recovered(forces: ForceIntegration, charges: np.ndarray, steps: list[float]) -> np.ndarray:
    found = []
    for charge, step in zip(charges, steps, strict=True):
        forces.advance(charge, step)
        found.append(forces.raw.copy())
    return np.array(found)


def started(offset: np.ndarray = NONE) -> ForceIntegration:
    forces = ForceIntegration(TAU, PER_CHARGE, NONE, math.inf)
    forces.start(offset / PER_CHARGE)
    return forces


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
    assert len(set(steps)) > 64  # as many as are kept
    forces = [math.sin(0.1 * number) for number in range(300)]
    found = recovered(started(), leaky_charge(forces, steps), steps)
    np.testing.assert_allclose(found[:, 1], forces, rtol=0, atol=1e-10)


def test_the_signal_is_the_charge_of_the_last_scan_as_a_force() -> None:
    forces = started(OFFSET)
    assert forces.signal == pytest.approx(OFFSET)
    forces.advance(np.array([1e-5, 1e-6, -2e-5]), 1e-3)
    assert forces.signal == pytest.approx([0.2, -0.1, -1.0])


def test_a_jump_leaks_by_an_unknown_share_of_a_long_step() -> None:
    forces = ForceIntegration(TAU, PER_CHARGE, NONE, 0.02)
    assert forces.advance(1.0 / PER_CHARGE, 0.02) == 0.0
    assert not forces.jumped.any()
    before = forces.raw.copy()
    total = forces.advance(3.0 / PER_CHARGE, 0.03)
    lost = np.abs(forces.raw - before) * (0.03 / TAU) / math.sqrt(12.0)
    assert total == pytest.approx(lost.sum())
    assert forces.lost == pytest.approx(lost)
    assert forces.jumped == pytest.approx(lost**2)


CASES = st.tuples(
    st.one_of(st.integers(1, 100), st.integers(1, 64).map(lambda side: side * side)),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.1, 1.0]),
)
"""Number of taxels, seed, share of faulty ones."""


@examples(8, 100)
def test_every_scan_is_as_by_the_reference(count: int) -> None:
    each_of(count, CASES, lambda case: compare(*case))


def compare(taxels: int, seed: int, ill: float) -> None:
    """Jittered steps, gaps of lost scans, blocks, corrections, faulty taxels, touches, films that warm."""
    random = np.random.default_rng(seed)
    tau, per_kelvin = random.uniform(0.01, 60.0, taxels), random.uniform(-0.2, -0.1, taxels)
    per_charge = random.uniform(1e4, 1e5, taxels)
    compiled, plain = (
        make(tau, per_charge, per_kelvin, 0.01) for make in (ForceIntegration, force_integration.ForceIntegration)
    )
    both, signal = (compiled, plain), random.normal(0.0, 0.1, taxels)
    for one in both:
        one.start(signal / per_charge)
    for scan in range(60):
        if scan % 15 == 10:
            set_block(both, random, taxels)
        ignored = random.random(taxels) < ill
        step = random.choice([1e-3, 1.1e-3, 0.9e-3, 0.05, random.uniform(1e-4, 0.2)])
        signal = signal + random.normal(0.0, 1e-3, taxels) + random.choice([0.0, 0.02]) * random.random(taxels)
        lost = [one.advance(signal / per_charge, step) for one in both]
        assert lost[0] == pytest.approx(lost[1], rel=1e-12)
        for one in both:
            one.follow_untouched()
        most = random.choice([-1.0, 0.003, 1.0])
        removed = [one.remove_uniform(ignored, 0.01, most) for one in both]
        assert removed[0] == pytest.approx(removed[1], rel=1e-11, abs=1e-12)
        same(compiled, plain)


def set_block(
    both: tuple[ForceIntegration, force_integration.ForceIntegration], random: np.random.Generator, taxels: int
) -> None:
    """End the block of both as an estimator does."""
    correction, rate = random.normal(0.0, 0.1, (2, taxels))
    untouched = np.flatnonzero(random.random(taxels) < random.choice([0.0, 0.5, 1.0]))
    small, share = random.normal(0.0, 0.01, len(untouched)), random.random()
    for one in both:
        one.start_block()
        one.correction[:], one.rate[:] = correction, rate
        one.lost[: taxels // 2] = 0.0
        one.watch(untouched, small, share)
        if share < 0.1:
            one.watch_none()


def same(compiled: ForceIntegration, plain: force_integration.ForceIntegration) -> None:
    for name in ("raw", "change", "correction", "rate", "force", "sum", "raw_sum", "jumped", "lost", "signal"):
        expected = getattr(plain, name)
        size = max(1.0, float(np.abs(expected).max()))
        np.testing.assert_allclose(getattr(compiled, name), expected, rtol=0, atol=1e-12 * size, err_msg=name)


def test_the_least_loaded_taxels_do_not_feel_a_touch_of_the_others() -> None:
    forces = ForceIntegration(np.full(10, 5.0), np.ones(10), np.full(10, -0.1), 1.0)
    forces.advance(np.array([0.01, 0.02, 0.01, 0.5, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4]), 1e-6)
    assert forces.remove_uniform(np.zeros(10, np.bool_), 0.1, 1.0) == pytest.approx(0.02, rel=1e-6)
    assert forces.force[0] == pytest.approx(-0.01, rel=1e-4)


@pytest.mark.parametrize(
    ("noticeable", "most"), [(1.0, 1.0), (0.1, 0.0), (0.1, -0.1)], ids=["too small", "none left", "below none"]
)
def test_no_uniform_change_is_removed(noticeable: float, most: float) -> None:
    forces = ForceIntegration(np.full(10, 5.0), np.ones(10), np.full(10, -0.1), 1.0)
    forces.advance(np.full(10, 0.5), 1e-6)
    before = forces.force.copy()
    assert forces.remove_uniform(np.zeros(10, np.bool_), noticeable, most) == 0.0
    assert (forces.force == before).all()


def test_fewer_taxels_than_a_fingertip_presses_show_no_uniform_change() -> None:
    forces = ForceIntegration(np.full(10, 5.0), np.ones(10), np.full(10, -0.1), 1.0)
    forces.advance(np.full(10, 0.5), 1e-6)
    assert forces.remove_uniform(np.arange(10) >= 4, 0.1, 1.0) == 0.0
    assert forces.remove_uniform(np.arange(10) >= 5, 0.1, 1.0) == pytest.approx(0.5, rel=1e-5)


def test_the_state_outlives_its_owner() -> None:
    force = ForceIntegration(TAU, PER_CHARGE, NONE, 1.0).force
    force[:] = 1.0
    assert force.sum() == 3.0


REFUSED = {
    "charges of another array": lambda forces: forces.advance(np.zeros(4), 1e-3),
    "start with another array": lambda forces: forces.start(np.zeros(2)),
    "no step": lambda forces: forces.advance(np.zeros(3), 0.0),
    "negative step": lambda forces: forces.advance(np.zeros(3), -1.0),
    "endless step": lambda forces: forces.advance(np.zeros(3), math.inf),
    "unknown step": lambda forces: forces.advance(np.zeros(3), math.nan),
    "taxel after the last": lambda forces: forces.watch(np.array([3]), np.zeros(1), 0.5),
    "taxel before the first": lambda forces: forces.watch(np.array([-1]), np.zeros(1), 0.5),
    "too few small forces": lambda forces: forces.watch(np.array([0, 1]), np.zeros(1), 0.5),
    "faults of another array": lambda forces: forces.remove_uniform(np.zeros(2, np.bool_), 0.1, 1.0),
    "responses of another array": lambda _: ForceIntegration(TAU, PER_CHARGE, np.zeros(2), 1.0),
    "charges per force of another array": lambda _: ForceIntegration(TAU, np.ones(2), NONE, 1.0),
    "no taxel": lambda _: ForceIntegration(np.zeros(0), np.zeros(0), np.zeros(0), 1.0),
}


@pytest.mark.parametrize("call", REFUSED.values(), ids=REFUSED.keys())
def test_wrong_arguments_are_refused(call: Callable[[ForceIntegration], object]) -> None:
    with pytest.raises(ValueError, match="must"):
        call(ForceIntegration(TAU, PER_CHARGE, NONE, 1.0))


@pytest.mark.parametrize("module", [ForceIntegration, force_integration.ForceIntegration])
def test_charge_leaks_as_the_temperature_has_it(module: Callable[..., ForceIntegration]) -> None:
    # Halved within 15 K: 5 K above the calibration, the time constants are a fifth shorter.
    per_kelvin, warmer = math.log(2.0) / 15.0, 5.0
    faster = math.exp(per_kelvin * warmer)
    forces = module(TAU, PER_CHARGE, NONE, math.inf, leak_per_kelvin=per_kelvin, leak_temperature=25.0)
    forces.process(NONE, np.array([25.0 + warmer, math.nan], np.float32), MILLISECOND)
    forces.start(NONE)
    forces.start_block()
    assert forces.warmer == warmer
    assert forces.leak == pytest.approx(faster)
    steps = [MILLISECOND] * 200
    held = [1.0] * 200
    charges = leaky_charge(held, [faster * step for step in steps])  # in time that passes faster
    np.testing.assert_allclose(recovered(forces, charges, steps), np.ones((200, 3)), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("module", [ForceIntegration, force_integration.ForceIntegration])
def test_leakage_is_that_of_the_calibration_while_no_temperature_is_known(
    module: Callable[..., ForceIntegration],
) -> None:
    forces = module(TAU, PER_CHARGE, NONE, math.inf, leak_per_kelvin=0.05, leak_temperature=25.0)
    forces.start_block()
    assert forces.leak == 1.0
    forces.process(NONE, np.array([1e4], np.float32), MILLISECOND)  # a sensor that is wrong does not stop the leakage
    forces.start_block()
    assert 1.0 < forces.leak < 10.0
