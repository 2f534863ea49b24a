# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charge of the simulated taxels against closed forms, and which taxels are computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from posfet_model.sensor.description import load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.taxel_charge import DEACTIVATE_INTERVAL, PLAY_HALF_WIDTHS, TaxelCharge
from posfet_sim.device.taxel_variation import TaxelParameters, draw_taxel_parameters
from posfet_sim.loads import Patch

SENSOR = load_sensor()
ROWS, COLS, TAXELS = SENSOR.layout.rows, SENSOR.layout.cols, SENSOR.layout.taxels
STEP = 1e-3
PARAMETERS = replace(
    draw_taxel_parameters(SENSOR, ErrorModel.none(), 0),
    charge_per_newton=np.linspace(1e-5, 2e-5, TAXELS),
    charge_per_kelvin=np.linspace(-3e-5, -5e-5, TAXELS),
    leak_time_constant=np.linspace(0.05, 0.5, TAXELS),
)
TAU, PER_NEWTON, PER_KELVIN = (
    PARAMETERS.leak_time_constant,
    PARAMETERS.charge_per_newton,
    PARAMETERS.charge_per_kelvin,
)


def made(hysteresis: float = 0.0, compute_all: bool = True, parameters: TaxelParameters = PARAMETERS) -> TaxelCharge:
    return TaxelCharge(SENSOR, parameters, hysteresis, compute_all)


def patch(rows: slice, cols: slice) -> Patch:
    return Patch(rows, cols, np.zeros((1, rows.stop - rows.start, cols.stop - cols.start)))


def advance(charge: TaxelCharge, force: np.ndarray, rise: float = 0.0, step: float = STEP) -> np.ndarray:
    """Advance by scans in which every taxel has the same force [N], shape [scans]; return the charges."""
    every = np.repeat(np.asarray(force, float)[:, None], TAXELS, axis=1)
    return charge.advance(every, np.full(len(every), rise), np.full(len(every), step))


@pytest.mark.parametrize("step", [1e-4, 1e-3, 0.1, 3.0])
def test_a_force_step_leaks_as_in_the_closed_form(step: float) -> None:
    found = advance(made(), np.full(20, 2.0), step=step)
    # The force rises over the first step, of which the mean share is left; then the charge decays.
    left = TAU / step * (1 - np.exp(-step / TAU))
    for scan in range(1, 21):
        expected = 2.0 * PER_NEWTON * left * np.exp(-(scan - 1) * step / TAU)
        np.testing.assert_allclose(found[scan], expected, rtol=1e-9, atol=1e-20)  # rounding of a factor near 1
    assert (found[0] == 0.0).all()


def test_a_ramp_leads_to_rate_times_time_constant() -> None:
    charge = made()
    found = advance(charge, 0.5 * STEP * np.arange(1, 10_001))
    np.testing.assert_allclose(found[-1], 0.5 * PER_NEWTON * TAU, rtol=1e-8)
    np.testing.assert_array_equal(charge.charge, found[-1])


def test_a_temperature_step_generates_charge_without_force() -> None:
    found = advance(made(), np.zeros(1), rise=-0.5, step=0.02)
    left = TAU / 0.02 * (1 - np.exp(-0.02 / TAU))
    np.testing.assert_allclose(found[1], -0.5 * PER_KELVIN * left, rtol=1e-12)


def test_one_call_is_as_many_and_steps_of_any_length_are_exact() -> None:
    random = np.random.default_rng(3)
    steps, force = random.uniform(1e-4, 0.05, 12), random.uniform(0.0, 3.0, (12, TAXELS))
    rise = random.uniform(-1.0, 1.0, 12)
    once, often = made(), made()
    found = once.advance(force, rise, steps)
    for scan in range(12):
        one = often.advance(force[scan : scan + 1], rise[scan : scan + 1], steps[scan : scan + 1])
        np.testing.assert_allclose(one[1], found[scan + 1], rtol=1e-12)
    assert once.updates == often.updates == 12 * TAXELS


def test_decay_is_an_exponential_in_the_time_since_the_last_scan() -> None:
    charge = made()
    before = advance(charge, np.array([2.0]))[-1].copy()
    times = np.array([0.01, 0.3, 2.0])
    np.testing.assert_allclose(charge.decay(times), before * np.exp(-times[:, None] / TAU), rtol=1e-12)
    # The last of the times is the state from which the force is released.
    released = advance(charge, np.array([0.0]))[-1]
    left = TAU / STEP * (1 - np.exp(-STEP / TAU))
    np.testing.assert_allclose(released, before * np.exp(-2.001 / TAU) - 2.0 * PER_NEWTON * left, rtol=1e-9)


def test_single_precision_stays_single_and_close() -> None:
    single = made(parameters=PARAMETERS.single_precision())
    found = advance(single, np.full(50, 2.0))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, advance(made(), np.full(50, 2.0)), rtol=2e-5)


def test_a_patch_activates_its_taxels_and_their_neighbours() -> None:
    charge = made(compute_all=False)
    assert charge.active.size == 0
    charge.activate([patch(slice(1, 2), slice(0, 2))])
    expected = {row * COLS + col for row in (0, 1, 2) for col in (0, 1, 2)}
    assert set(charge.active.tolist()) == expected
    charge.activate([patch(slice(4, 5), slice(4, 5))])
    assert set(charge.active.tolist()) == expected | {row * COLS + col for row in (3, 4) for col in (3, 4)}


def test_active_taxels_have_the_charge_that_they_have_when_all_are_computed() -> None:
    some, every = made(compute_all=False), made()
    force = np.zeros((30, TAXELS))
    force[:, COLS + 1] = np.linspace(0.1, 2.0, 30)
    some.activate([patch(slice(1, 2), slice(1, 2))])
    steps, rise = np.full(30, STEP), np.zeros(30)
    found, expected = some.advance(force, rise, steps), every.advance(force, rise, steps)
    np.testing.assert_array_equal(found, expected[:, some.active])
    some.activate([patch(slice(3, 5), slice(3, 5))])  # keeps the state of those before
    force[:, -1] = 1.0
    found, expected = some.advance(force, rise, steps), every.advance(force, rise, steps)
    np.testing.assert_allclose(found, expected[:, some.active], rtol=1e-12)
    assert some.updates < every.updates


def test_taxels_without_charge_become_inactive_after_a_while_and_those_with_stay() -> None:
    charge = made(compute_all=False)
    charge.activate([patch(slice(0, ROWS), slice(0, COLS))])
    force = np.zeros((DEACTIVATE_INTERVAL - 1, TAXELS))
    force[:, 0] = 2.0
    charge.advance(force, np.zeros(len(force)), np.full(len(force), STEP))
    assert not charge.deactivate_discharged()
    charge.advance(force[:1], np.zeros(1), np.full(1, STEP))
    assert charge.deactivate_discharged()
    assert set(charge.active.tolist()) == {0, 1, COLS}
    assert charge.charge[0] > 0.0
    assert (charge.charge[1:] == 0.0).all()


def test_charge_that_is_too_small_to_count_is_gone_when_its_taxel_becomes_inactive() -> None:
    charge = made(compute_all=False)
    everywhere = [patch(slice(0, ROWS), slice(0, COLS))]
    charge.activate(everywhere)
    advance(charge, np.array([2.0, 0.0]))
    advance(charge, np.zeros(DEACTIVATE_INTERVAL), step=0.1)
    assert charge.deactivate_discharged()
    assert charge.active.size == 0
    charge.activate(everywhere)
    assert charge.active.size == TAXELS
    assert (charge.charge == 0.0).all()


def test_the_patches_of_the_call_before_are_activated_too_as_their_forces_may_end() -> None:
    charge = made(compute_all=False)
    charge.activate([patch(slice(0, 1), slice(0, 1))])
    advance(charge, np.zeros(DEACTIVATE_INTERVAL))
    assert charge.deactivate_discharged()
    charge.activate([patch(slice(4, 5), slice(4, 5))])
    first, second = {0, 1, COLS, COLS + 1}, {TAXELS - 1, TAXELS - 2, TAXELS - 1 - COLS, TAXELS - 2 - COLS}
    assert set(charge.active.tolist()) == first | second
    advance(charge, np.zeros(DEACTIVATE_INTERVAL))
    assert charge.deactivate_discharged()
    charge.activate([])
    assert set(charge.active.tolist()) == second


def test_where_all_are_computed_none_becomes_inactive() -> None:
    charge = made()
    advance(charge, np.zeros(2 * DEACTIVATE_INTERVAL))
    assert not charge.deactivate_discharged()
    assert charge.active.size == TAXELS


@pytest.mark.parametrize("pyroelectric", [True, False])
def test_a_temperature_change_activates_every_taxel_of_a_pyroelectric_film(pyroelectric: bool) -> None:
    parameters = PARAMETERS if pyroelectric else replace(PARAMETERS, charge_per_kelvin=np.zeros(TAXELS))
    charge = made(compute_all=False, parameters=parameters)
    charge.activate_all()
    assert charge.active.size == (TAXELS if pyroelectric else 0)


FOREVER = replace(PARAMETERS, leak_time_constant=np.full(TAXELS, 1e12))
"""Taxels that do not leak: the charge is the effective force."""
FULL = SENSOR.device.force_max


def effective(charge: TaxelCharge, force: np.ndarray) -> np.ndarray:
    """Return the effective force of the first taxel relative to full scale, for forces relative to it."""
    return advance(charge, FULL * force)[1:, 0] / PER_NEWTON[0] / FULL


def test_the_loop_of_hysteresis_has_its_width_and_closes() -> None:
    charge = made(hysteresis=0.02, parameters=FOREVER)
    up, down = np.linspace(0.0, 1.0, 201), np.linspace(1.0, 0.0, 201)
    effective(charge, up)
    loop_down, loop_up = effective(charge, down), effective(charge, up)
    width = np.abs(loop_down[::-1] - loop_up)
    assert width.max() == pytest.approx(0.02, rel=1e-6)
    assert width[0] == pytest.approx(0.0, abs=1e-9)
    assert width[-1] == pytest.approx(0.0, abs=1e-9)


def test_hysteresis_does_not_depend_on_the_rate_nor_change_a_constant_force() -> None:
    slow, fast = made(0.02, parameters=FOREVER), made(0.02, parameters=FOREVER)
    path = np.concatenate([np.linspace(0, 0.8, 81), np.linspace(0.8, 0.3, 51)])
    assert effective(slow, path)[-1] == pytest.approx(effective(fast, np.array([0.8, 0.3]))[-1], rel=1e-9)
    held = effective(slow, np.full(20, 0.3))
    assert np.ptp(held) < 1e-12


def test_small_changes_have_less_effect_than_large_ones_as_in_rayleighs_law() -> None:
    width = 0.02
    charge = made(width, parameters=FOREVER)
    weight = width / (2 * sum(PLAY_HALF_WIDTHS))
    turned, small, large = effective(charge, np.array([0.6, 0.5, 0.501, 0.999]))[1:]
    # No play moves within its half-widths of the turn at 0.6; then each follows at its half-width below.
    assert small - turned == pytest.approx((1 - 3 * weight) * 0.001, rel=1e-6)
    moved = sum((0.999 - half) - (0.6 - half) for half in PLAY_HALF_WIDTHS)
    assert large - small == pytest.approx((1 - 3 * weight) * 0.498 + weight * moved, rel=1e-6)
