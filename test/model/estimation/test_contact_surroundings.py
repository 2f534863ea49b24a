# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces beside a contact: neighbours, and the decline towards them, against forces under spheres."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from posfet_core.scan_path import DIAGONAL, ContactSurroundings
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.grid import compiled_layout
from reference.dense_pressure import sphere_forces

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
THRESHOLD = SENSOR.contact.threshold
LINE = ContactSurroundings(compiled_layout(replace(LAYOUT, rows=1, cols=6)))
SQUARE = ContactSurroundings(compiled_layout(replace(LAYOUT, rows=3, cols=3)))


def line(*force: float) -> list[float]:
    return LINE.geometric_decline(np.array(force), 0.0).tolist()


def test_the_neighbours_of_a_taxel_share_an_edge_or_a_corner_with_it() -> None:
    one = np.zeros(9, np.bool_)
    one[0] = True
    assert np.flatnonzero(SQUARE.dilated(one)).tolist() == [0, 1, 3, 4]


def test_a_neighbour_at_a_corner_counts_less() -> None:
    # The skin spreads a force along both axes on the way to a corner.
    force = np.zeros(9)
    force[0] = 1.0
    assert SQUARE.greatest_neighbour(force).tolist() == [0.0, 1.0, 0.0, 1.0, DIAGONAL, 0.0, 0.0, 0.0, 0.0]


def test_an_unknown_force_is_the_greatest_that_it_can_be_beside_the_others() -> None:
    assert LINE.completed(np.array([8.0, 4.0, math.nan, 0.0, 0.0, 0.0]), 0.0).tolist() == [8.0, 4.0, 2.0, 0.0, 0.0, 0.0]
    assert LINE.completed(np.array([0.0, 1.0, 4.0, math.nan, 8.0, 4.0]), 0.0)[3] == 8.0
    assert LINE.completed(np.array([1.0, 0.0, 0.0, 0.0, math.nan, 0.0]), 0.0)[4] == 0.0


def test_a_geometric_decline_continues() -> None:
    assert line(8.0, 4.0, 2.0, 0.0, 0.0, 0.0)[3] == 1.0
    assert line(0.0, 0.0, 0.0, 2.0, 4.0, 8.0)[2] == 1.0


def test_a_force_that_rises_towards_a_taxel_is_the_greatest_that_it_can_feel() -> None:
    assert line(1.0, 2.0, 4.0, 0.0, 0.0, 0.0)[3] == 4.0


def test_the_line_with_the_greatest_force_counts() -> None:
    assert line(4.0, 2.0, 0.0, 3.0, 3.0, 0.0)[2] == 3.0


@pytest.mark.parametrize("unknown", [0, 1])
def test_the_greatest_force_stands_in_for_one_that_is_unknown(unknown: int) -> None:
    force = [math.nan, 2.0, 0.0, 0.0, 0.0, 8.0] if unknown == 0 else [2.0, 0.0, 0.0, 0.0, 0.0, 8.0]
    assert line(*force)[2 - unknown] == 0.5


def test_without_forces_there_is_no_decline() -> None:
    assert line(*[0.0] * 6) == [0.0] * 6
    assert LINE.geometric_decline(np.full(6, math.nan), 1e-3).tolist() == [0.0] * 6


@pytest.mark.slow
@pytest.mark.parametrize("radius", [4e-3, 5e-3, 8e-3])
def test_forces_beside_a_fingertip_are_within_the_priors_of_the_decline(radius: float) -> None:
    # 200 places each; the common part is estimated anew in every touch, and own parts differ by as much as it.
    p, random, surroundings = ErrorPriors(), np.random.default_rng(1), ContactSurroundings(compiled_layout(LAYOUT))
    shares = []
    for x, y, newton in random.uniform((-1.5e-3, -1.5e-3, 0.3), (1.5e-3, 1.5e-3, 2.0), (200, 3)):
        force = sphere_forces(x, y, newton, radius, 1e6, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)
        touched = force > THRESHOLD
        beside = surroundings.dilated(touched) & ~touched
        decline = surroundings.geometric_decline(force, 0.0)
        strong = beside & (decline > 0.2 * THRESHOLD)
        shares.extend(force[strong] / decline[strong])
    assert len(shares) > 500
    assert max(shares) <= 1.0  # log-concave
    assert np.mean(np.abs(np.array(shares) - p.tail) < 2.0 * math.hypot(p.tail, p.tail_spread)) > 0.95
    assert np.mean(shares) == pytest.approx(p.tail, abs=p.tail_spread)
