# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Loads of a fingertip in MuJoCo, compared with statics."""

import math

import numpy as np
import pytest

from posfet_model.sensor.description import load_sensor
from posfet_sim.contact.indenters import Sphere
from posfet_sim.physics.face_pressure import FacePressure
from posfet_sim.physics.mujoco_loads import MujocoLoads

mujoco = pytest.importorskip("mujoco")

SENSOR = load_sensor()
GRAVITY = 9.81


def at_rest(geom: str, *, turn: float = 0.0, tilt: float = 0.0, friction: float = 1.0, gravity: float = 0.0):
    """Return model, data and loads of an object that rests on a fingertip, whose array looks up, turned about z."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.001" cone="elliptic" impratio="20"
          gravity="{GRAVITY * math.sin(tilt) + gravity} 0 {-GRAVITY * math.cos(tilt)}"/>
        <default><geom friction="{friction}" condim="4"/></default>
        <worldbody>
          <body pos="0.1 0.2 0.3" euler="0 0 {math.degrees(turn)}">
            <geom name="tip" type="box" size="0.01 0.01 0.005" pos="0 0 -0.005"/><site name="array"/></body>
          <body name="object" pos="0.1 0.2 0.3"><freejoint/>{geom}</body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    loads = MujocoLoads(SENSOR, model, data, "array", ["tip"])
    for _ in range(500):
        mujoco.mj_step(model, data)
    loads.read()
    return model, data, loads


def lower_face(data) -> float:
    """Return x of the middle of the block's lower face from the array [m]: it creeps and tilts on the soft contact."""
    block = data.geom("block")
    return (block.xpos - 0.002 * block.xmat.reshape(3, 3)[:, 2])[0] - 0.1


BALL = '<geom name="ball" type="sphere" size="0.004" pos="0.001 0.0005 0.004" mass="0.05"/>'
BLOCK = '<geom name="block" type="box" size="0.0015 0.002 0.002" pos="0.001 0 0.002" mass="0.05"/>'


@pytest.mark.parametrize("geom", [BALL, BLOCK])
def test_the_weight_of_an_object_is_on_the_taxels(geom: str) -> None:
    _, data, loads = at_rest(geom)
    assert loads.time == pytest.approx(data.time)
    assert loads.balance.engine == pytest.approx(0.05 * GRAVITY, rel=1e-3)
    assert loads.balance.taxels == pytest.approx(loads.balance.engine, rel=5e-3)
    assert isinstance(loads.contacts[0].pressure, Sphere if geom == BALL else FacePressure)
    [patch] = loads.forces([data.time])
    centre = patch.force[0].ravel() @ SENSOR.layout.positions / patch.force.sum()
    assert centre[0] == pytest.approx(0.001, abs=5e-5)


def test_positions_and_forces_are_in_the_frame_of_the_array() -> None:
    turn = math.radians(30)
    _, data, loads = at_rest(BLOCK, turn=turn, tilt=0.2)
    [contact] = loads.contacts
    c, s = math.cos(turn), math.sin(turn)
    push = 0.05 * GRAVITY * math.sin(0.2)  # along x of the world, on the block and by it on the array
    assert contact.force == pytest.approx(0.05 * GRAVITY * math.cos(0.2), rel=0.01)
    np.testing.assert_allclose(contact.tangential_force, [push * c, -push * s], rtol=0.01)
    middle = lower_face(data)
    np.testing.assert_allclose(contact.position, [middle * c, -middle * s], atol=2e-6)
    assert math.remainder(contact.angle + turn, math.pi / 2) == pytest.approx(0.0, abs=1e-3)
    assert isinstance(contact.pressure, FacePressure)
    assert sorted((contact.pressure.half_length, contact.pressure.half_width)) == pytest.approx(
        [1.5e-3, 2e-3], rel=1e-3
    )


def test_a_tilted_block_presses_with_its_lower_edge() -> None:
    """The line of the weight meets the face at the centre of pressure."""
    _, data, loads = at_rest(BLOCK, tilt=0.3)
    [contact] = loads.contacts
    along, across = contact.pressure.centre
    centre = contact.position[0] + math.cos(contact.angle) * along - math.sin(contact.angle) * across
    block = data.geom("block").xpos - [0.1, 0.2, 0.3]
    assert centre == pytest.approx(block[0] + block[2] * math.tan(0.3), abs=5e-5)  # it is not quite parallel
    assert centre > lower_face(data) + 4e-4


def test_a_block_that_slides_does_so_at_the_speed_of_the_engine() -> None:
    _, data, loads = at_rest(BLOCK, friction=0.1, gravity=0.3 * GRAVITY)
    velocity = data.qvel[0]
    assert velocity > 0.05
    assert loads.contacts == () or loads.contacts[0].sliding[0] == pytest.approx(velocity, rel=0.05)


def test_contacts_on_other_faces_and_of_other_objects_do_not_count() -> None:
    _, _, loads = at_rest('<geom name="away" type="sphere" size="0.004" pos="0.05 0 0.004" mass="0.05"/>')
    assert loads.contacts == ()
    assert loads.balance.engine == 0.0


def test_a_missing_site_is_named() -> None:
    model, data, _ = at_rest(BALL)
    with pytest.raises(KeyError, match="nowhere"):
        MujocoLoads(SENSOR, model, data, "nowhere", ["tip"])
