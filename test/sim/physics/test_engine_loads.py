# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Loads from a physics engine: balance of forces, centre of pressure, and what the board makes of them."""

import doctest
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.physics import engine_loads
from posfet_sim.physics.engine_loads import EngineContact, EngineLoads
from posfet_sim.physics.face_pressure import FacePressure

SENSOR = load_sensor()
WIDE = replace(SENSOR, layout=replace(SENSOR.layout, rows=35, cols=35))  # beyond the reach of every contact below
FINE = replace(SENSOR, layout=replace(SENSOR.layout, rows=40, cols=40, pitch_x=0.75e-3, pitch_y=0.75e-3))
BALL = Sphere(radius=5e-3, effective_modulus=2e6)


def on_taxels(contacts: list[EngineContact], sensor=SENSOR) -> np.ndarray:
    loads = EngineLoads(sensor)
    loads.push(0.0, contacts)
    patches = loads.forces([0.0])
    layout = sensor.layout
    return patches[0].force[0] if patches else np.zeros((layout.rows, layout.cols))


places = st.floats(-4e-3, 4e-3)


@given(places, places, st.floats(0.01, 5.0), st.floats(-3.2, 3.2), st.floats(-1, 1), st.floats(-1, 1), st.booleans())
def test_taxels_and_the_cells_around_them_receive_the_whole_force_at_its_centre(x, y, force, angle, u, v, ball) -> None:
    face = FacePressure(3e-3, 2e-3, (u * 3e-3, v * 2e-3))
    contact = EngineContact("object", (x, y), force, BALL if ball else face, angle)
    wide = on_taxels([contact], WIDE)
    assert wide.sum() == pytest.approx(force, rel=1e-5)
    assert wide.min() >= -1e-9
    np.testing.assert_allclose(on_taxels([contact]), wide[15:20, 15:20], rtol=0, atol=1e-12)
    du, dv = (0.0, 0.0) if ball else face.centre
    cos, sin = math.cos(angle), math.sin(angle)
    fine = on_taxels([contact], FINE)  # cells as wide as those of the array displace the centre by up to 0.02 mm
    centre = fine.ravel() @ FINE.layout.positions / force
    np.testing.assert_allclose(centre, [x + cos * du - sin * dv, y + sin * du + cos * dv], rtol=0, atol=1e-7)


def test_the_balance_says_what_is_outside_the_array() -> None:
    loads = EngineLoads(SENSOR)
    edge = 2.5 * SENSOR.layout.pitch_x
    loads.push(0.0, [EngineContact("ball", (edge, 0.0), 2.0, BALL), EngineContact("ball 2", (0.1, 0.1), 1.0, BALL)])
    assert loads.balance.engine == 3.0
    assert loads.balance.taxels == pytest.approx(1.0, abs=1e-5)  # half of the ball on the edge
    assert loads.balance.outside == pytest.approx(2.0, abs=1e-5)


def test_between_two_states_forces_and_temperature_are_linear() -> None:
    loads = EngineLoads(SENSOR)
    loads.push(1.0, [EngineContact("ball", (0.0, 0.0), 1.0, BALL)], temperature=25.0)
    loads.push(1.1, [], temperature=26.0)
    [patch] = loads.forces([1.0, 1.025, 1.1])
    np.testing.assert_allclose(patch.force.sum(axis=(1, 2)), [1.0, 0.75, 0.0], atol=1e-5)
    assert loads.temperatures([1.0, 1.05]) == pytest.approx([25.0, 25.5])


def test_the_board_leads_the_engine_and_never_asks_ahead() -> None:
    asked: list[float] = []

    def advance(time: float) -> None:
        asked.append(time)
        loads.push(time, [EngineContact("ball", (0.0, 0.0), min(time, 0.1) * 10, BALL)])

    loads = EngineLoads(SENSOR, advance)
    board, scan = SimulatedBoard(SENSOR, loads, 1), Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    for index in range(200):
        board.scan(index, scan)
        assert asked == sorted(asked)
        assert max([0.0, *asked]) == pytest.approx(board.time)
    assert board.truth().force.sum() == pytest.approx(1.0, abs=1e-5)
    assert board.truth().objects.names == ("ball",)
    assert board.truth().objects.contact_forces.tolist() == [1.0]


def test_an_engine_may_be_early_by_the_rounding_of_its_time() -> None:
    loads = EngineLoads(SENSOR)
    loads.push(sum([1e-4] * 3000) - 1e-10, [EngineContact("ball", (0.0, 0.0), 1.0, BALL)])
    [patch] = loads.forces([0.3])
    assert patch.force.sum() == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(ValueError, match="push first"):
        loads.forces([0.3 + 1e-8])


def test_states_that_no_scan_needs_are_forgotten() -> None:
    loads = EngineLoads(SENSOR, lambda time: loads.push(time, []))
    for index in range(1000):
        loads.forces([1e-3 * index])
    assert len(loads._states) < 110


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (lambda loads: loads.push(-1.0, []), "time"),
        (lambda loads: loads.push(0.0, [EngineContact("a", (0.0, 0.0), -1.0, BALL)]), "force"),
        (lambda loads: loads.push(0.0, [EngineContact("a", (math.nan, 0.0), 1.0, BALL)]), "position"),
        (lambda loads: loads.push(0.0, [], temperature=math.inf), "temperature"),
        (lambda loads: loads.forces([0.5]), "push first"),
        (lambda loads: EngineLoads(replace(SENSOR, layout=replace(SENSOR.layout, bend_radius=0.02))), "flat"),
    ],
)
def test_what_cannot_be_is_refused(what, message: str) -> None:
    loads = EngineLoads(SENSOR)
    with pytest.raises(ValueError, match=message):
        what(loads)


def test_the_example_in_the_documentation_runs() -> None:
    results = doctest.testmod(engine_loads)
    assert results.attempted >= 5
    assert results.failed == 0


def test_objects_are_those_of_the_newest_state_up_to_a_time() -> None:
    loads = EngineLoads(SENSOR)
    loads.push(1.0, [EngineContact("ball", (0.0, 0.0), 1.0, BALL)])
    loads.push(1.1, [EngineContact("ball", (1e-3, 0.0), 2.0, BALL)])
    for time, forces in ((0.5, []), (1.0, [1.0]), (1.05, [1.0]), (1.1 - 1e-10, [2.0]), (1.1, [2.0]), (1.2, [2.0])):
        assert loads.objects(time).contact_forces.tolist() == forces, time
