# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Shipped scenes: the applied force at given times, and what of it the taxels carry (ground truth alone)."""

from dataclasses import replace

import numpy as np
import pytest

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.film_effects import FilmEffects
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()

APPLIED: dict[str, tuple[tuple[float, float], ...]] = {
    "flat_pad_fast": (
        *((1.0, 0.0), (1.05, 1.0), (1.1, 2.0), (3.1, 2.0), (3.3, 0.0)),
        *((6.3, 0.0), (6.4, 1.0), (6.5, 2.0), (8.7, 0.0), (11.7, 0.0), (11.85, 1.0), (12.0, 2.0), (14.2, 0.0)),
    ),
    "flat_pad_slow": ((1.0, 0.0), (1.5, 1.0), (2.0, 2.0), (5.0, 2.0), (5.5, 1.0), (6.0, 0.0)),
    "mixed": (
        *((1.0, 0.0), (1.5, 1.0), (3.0, 0.0), (3.7, 1.5), (5.0, 0.0), (6.0, 0.5), (7.0, 0.0), (8.5, 1.2), (9.5, 0.0)),
        *((10.6, 1.2), (11.2, 1.2), (12.9, 1.2), (14.0, 0.0), (15.2, 2.0), (25.0, 2.0), (35.2, 2.0), (35.5, 0.0)),
    ),
    "hold_10s": ((1.0, 0.0), (1.1, 1.0), (1.2, 2.0), (11.2, 2.0), (11.35, 1.0), (11.5, 0.0)),
    "hold": ((1.0, 0.0), (1.2, 2.0), (30.0, 2.0), (61.2, 2.0), (61.5, 0.0)),
    "hold_300s": ((1.0, 0.0), (1.2, 2.0), (150.0, 2.0), (301.2, 2.0), (301.35, 1.0), (301.5, 0.0)),
    "slow_press": ((1.0, 0.0), (6.0, 0.1), (11.0, 0.2), (15.0, 0.2), (15.3, 0.0)),
    "ring": ((0.3, 0.0), (0.4, 0.75), (0.5, 1.5), (1.3, 1.5), (1.5, 0.0), (2.2, 1.5), (3.0, 1.5), (3.2, 0.0)),
    "ridged_fingertip": ((0.3, 0.0), (0.5, 1.5), (1.4, 1.5), (2.3, 1.5), (2.5, 0.0)),
    "screw_head": ((0.3, 0.0), (0.5, 1.0), (1.4, 1.0), (2.2, 1.0), (2.4, 0.0)),
    "rolling": ((0.3, 0.0), (0.5, 1.5), (1.3, 1.5), (2.6, 1.5), (3.5, 0.0)),
    "stick_slip": ((0.3, 0.0), (0.5, 1.2), (0.8, 1.2), (0.82, 1.1), (0.86, 1.2), (1.0, 1.2), (2.92, 1.1), (3.4, 0.0)),
    "three_fingers_roll": ((0.3, 0.0), (0.4, 0.5), (0.5, 1.4), (0.6, 2.15), (0.7, 2.5), (1.5, 2.5), (2.9, 0.0)),
    "tap_1ms": ((0.3, 0.0), (0.3005, 1.0), (0.301, 0.0), (0.5508, 1.0), (2.5532, 1.0), (2.5537, 0.0)),
    "contact_at_power_on": ((0.0, 1.0), (3.0, 1.0), (3.1, 0.5), (3.2, 0.0), (5.2, 1.0), (6.7, 0.0), (100.0, 0.0)),
    "overload": ((1.0, 0.0), (1.3, 20.0), (2.3, 20.0), (2.6, 0.0), (3.6, 0.0), (3.8, 0.1), (5.8, 0.1), (6.0, 0.0)),
}
"""Time [s] and total force of the objects [N] by scene; halfway between keyframes it is the mean of theirs."""

CARRIED = {"flat_pad_fast": 0.959, "flat_pad_slow": 0.959}
"""Share of the force on the cells [1], where it is not all.

The tails of a Gaussian of s = 0.6 mm beyond the edge of the cells, 0.5 mm from that of a pad of L = 6.5 mm, are
2*s/L*(phi(z) - z*Phi(-z)) = 0.0209 of the force along each axis, z = 0.5/0.6.
"""


def taxels(loads: SceneLoads, time: float) -> np.ndarray:
    """Return the force on each taxel [N], shape [rows, cols]."""
    force = np.zeros((SENSOR.layout.rows, SENSOR.layout.cols))
    for patch in loads.forces([time]):
        force[patch.rows, patch.cols] += patch.force[0]
    return force


@pytest.mark.parametrize("name", APPLIED)
def test_a_scene_applies_its_force_at_its_times(name: str) -> None:
    loads = SceneLoads(load_scene(name, SENSOR), SENSOR)
    for time, force in APPLIED[name]:
        assert loads.objects(time).contact_forces.sum() == pytest.approx(force, abs=1e-9), time
        # Without a stated share the contact is inside: all but the tails of the skin's spread at the edge.
        share, margin = (CARRIED[name], 1e-3) if name in CARRIED else (1.0, 0.025)
        assert taxels(loads, time).sum() == pytest.approx(share * force, rel=margin, abs=1e-9), time


def test_the_flat_pad_leaves_no_taxel_untouched() -> None:
    for name, time in (("flat_pad_fast", 1.05), ("flat_pad_slow", 1.5)):
        force = taxels(SceneLoads(load_scene(name, SENSOR), SENSOR), time)
        assert force.min() > SENSOR.contact.threshold
        assert force.max() < 3 * force.min()


def test_the_fluctuating_hold_stays_within_its_limits_and_never_rests() -> None:
    loads = SceneLoads(load_scene("hold_fluctuating", SENSOR), SENSOR)
    times = np.arange(1.3, 301.2, 0.1)
    states = [loads.scene.states(time)[0] for time in times.tolist()]
    force = np.array([state.force for state in states])
    assert np.abs(force - 2.0).max() <= 0.1
    assert force.mean() == pytest.approx(2.0, abs=0.005)
    # Eight sines of an eighth of 0.1 N each: 0.1 N/8*sqrt(8/2) RMS, over more than 20 periods of most of them.
    assert force.std() == pytest.approx(0.025, rel=0.15)
    assert max(np.hypot(state.x - 0.2e-3, state.y + 0.1e-3) for state in states) <= 0.05e-3 * np.sqrt(2)
    assert all(loads.constant_until(time) == time for time in times[::100].tolist())
    assert loads.constant_until(301.5) == 305.0  # the next period


def test_stick_slip_moves_in_eight_jerks_and_rests_between_them() -> None:
    loads = SceneLoads(load_scene("stick_slip", SENSOR), SENSOR)
    begins = 0.8 + 0.3 * np.arange(8)
    for number, begin in enumerate(begins.tolist()):
        places = [loads.scene.states(time)[0].x for time in (begin, begin + 0.02, begin + 0.2)]
        expected = -1.8e-3 + 0.45e-3 * np.array([number, number + 1, number + 1])
        np.testing.assert_allclose(places, expected, rtol=0, atol=1e-12)
        assert loads.constant_until(begin + 0.1) == pytest.approx(begin + 0.3, abs=1e-9)


def test_the_overload_nearly_reaches_full_scale_and_no_rail() -> None:
    peak = taxels(SceneLoads(load_scene("overload", SENSOR), SENSOR), 2.0).max()
    assert 0.9 * SENSOR.device.force_max < peak <= SENSOR.device.force_max
    assert peak * SENSOR.volts_per_newton < SENSOR.amplifier.rail_high


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("hysteresis", [0.0, 0.01])
def test_a_contact_at_power_on_shows_only_when_it_ends(full: bool, hysteresis: float) -> None:
    model = replace(ErrorModel.none().without_noise(), hysteresis=hysteresis)
    loads = SceneLoads(load_scene("contact_at_power_on", SENSOR), SENSOR)
    board, scan = SimulatedBoard(SENSOR, loads, 0, model, compute_all=full), Scan.empty(1, SENSOR.layout.taxels)
    per_newton = charge_per_newton(SENSOR)
    for index in (0, 1, 1500, 3000):
        board.scan(index, scan)
        assert board.truth().force.sum() == pytest.approx(1.0, rel=1e-4)
        assert board.in_contact
        assert np.abs(board.charge()).max() < 1e-12 * abs(per_newton)
    board.scan(3200, scan)
    assert board.truth().force.sum() == 0.0
    # The release of 1 N within 0.2 s, less what leaked of it meanwhile. With hysteresis a small change of force counts
    # less, by up to 3/0.7 times the width of the loop (TaxelCharge); 1e-3: the force is linear over 1 ms.
    times = np.linspace(3.0, 3.2, 2001)
    force = np.array([loads.scene.states(time)[0].force for time in times.tolist()])
    kept = np.exp(-(3.2 - (times[1:] + times[:-1]) / 2) / SENSOR.device.leak_time_constant)
    released = board.charge().sum() / per_newton / float(np.diff(force) @ kept)
    assert 1 - 3 / 0.7 * hysteresis - 1e-3 < released < 1 + 1e-3


def test_a_film_with_effects_has_responded_to_a_contact_at_power_on() -> None:
    effects = replace(FilmEffects.hard(), leak_drift=0.0, gain_drift=0.0)  # those never rest
    loads = SceneLoads(load_scene("contact_at_power_on", SENSOR), SENSOR)
    board = SimulatedBoard(SENSOR, loads, 0, replace(ErrorModel.none().without_noise(), film=effects))
    scan, per_newton = Scan.empty(1, SENSOR.layout.taxels), abs(charge_per_newton(SENSOR))
    for index in (0, 10, 2000, 3000):
        board.scan(index, scan)
        # Nothing moves: relaxation, creep, warmth and the warming of the chip are complete, all charge has leaked away.
        assert np.abs(board.charge()).max() < 1e-12 * per_newton
        assert board.truth().chip_temperature == pytest.approx(25.0 + effects.chip_warming, rel=1e-4)
    board.scan(3200, scan)
    assert np.abs(board.charge()).max() > 0.1 * per_newton


def test_holds_cost_only_their_edges() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("hold_300s", SENSOR), SENSOR), 0)
    board.scan(301_000, Scan.empty(1, SENSOR.layout.taxels))
    # From 1 s to 1.2 s, and one step over the hold, of at most 25 taxels.
    assert board.taxel_updates <= 25 * 300
