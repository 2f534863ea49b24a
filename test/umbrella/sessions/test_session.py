# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sessions of a simulated board: streams that agree with each other and with the ground truth; errors of one line."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from itertools import islice

import numpy as np
import pytest

import posfet
from posfet.sessions.frames import CONTACT_DTYPE
from posfet.sessions.session import Session
from posfet_model import Calibration, load_sensor
from posfet_sim.scene import load_scene
from support.paths import PACKAGE


def press(**arguments: object) -> Session:
    return posfet.simulate("press", imperfections="none", duration=1.0, **arguments)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def arrays() -> posfet.Arrays:
    return press().arrays()


def test_importing_loads_nothing_else() -> None:
    program = "import sys, posfet; print(*sys.modules)"
    command = [sys.executable, "-c", program]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True, cwd=PACKAGE).stdout.split()
    assert not {name.partition(".")[0] for name in loaded} & {"numpy", "posfet_model", "rclpy", "can", "gymnasium"}


def test_simulating_needs_neither_ros_nor_python_can() -> None:
    program = "import sys, posfet; next(posfet.simulate().contacts()); print(*sys.modules)"
    command = [sys.executable, "-c", program]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in result.stdout.split()}
    assert not loaded & {"rclpy", "posfet_msgs", "can", "mcap", "rich", "gymnasium", "matplotlib"}


@pytest.mark.parametrize("name", posfet.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(posfet, name) is not None
    assert name in dir(posfet)


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'posfet' has no attribute 'simulat'"):
        posfet.simulat  # noqa: B018


def test_forces_agree_with_the_ground_truth(arrays: posfet.Arrays) -> None:
    assert len(arrays) == 1000
    assert arrays.force.shape == arrays.true_force.shape == arrays.counts.shape == (1000, 5, 5)
    valid = arrays.valid
    assert valid[-500:].all()
    true = arrays.true_force.sum(axis=(1, 2))
    assert np.abs(arrays.total - true)[valid].max() < 0.02
    np.testing.assert_allclose(arrays.wrench[valid, 2], -arrays.total[valid], atol=1e-6)
    assert np.isnan(arrays.wrench[~valid]).all()
    np.testing.assert_allclose(np.diff(arrays.time), 1e-3, atol=1e-6)
    assert arrays.time[0] == 0.0


def test_contacts_are_rows_with_units_of_the_contacts(arrays: posfet.Arrays) -> None:
    found = [contacts for contacts in press().contacts() if len(contacts)]
    table = arrays.contacts
    assert table.dtype == CONTACT_DTYPE
    assert len(table) == sum(map(len, found))
    last, contact = table[-1], found[-1][-1]
    assert (last["id"], last["sequence"]) == (contact.id, found[-1].sequence)
    assert tuple(last[["x", "y", "z"]]) == tuple(contact.position)
    assert last["force"] == contact.force
    assert contact.force == pytest.approx(arrays.true_force[-1].sum(), abs=0.05)
    assert contact.position.shape == contact.normal.shape == contact.velocity.shape == (3,)
    np.testing.assert_array_equal(found[-1].array()["id"], [contact.id])
    assert found[-1][:] == found[-1].items
    assert repr(contact).startswith(f"<Contact #{contact.id} ")


def test_every_stream_has_the_values_of_the_frames() -> None:
    frames = list(islice(press(seed=3), 450))
    for image, frame in zip(press(seed=3).images(), frames, strict=False):
        np.testing.assert_array_equal(image.force, frame.image.force)
        assert (image.time, image.sequence, image.valid) == (frame.time, frame.sequence, frame.valid)
    for wrench, frame in zip(press(seed=3).wrench(), frames, strict=False):
        np.testing.assert_array_equal(wrench.covariance, frame.wrench.covariance)
    for scan, frame in zip(press(seed=3).scans(), frames, strict=False):
        np.testing.assert_array_equal(scan.counts, frame.scan.counts)
    for truth, frame in zip(press(seed=3).truth(), frames, strict=False):
        assert frame.truth is not None
        np.testing.assert_array_equal(truth.force, frame.truth.force)
        assert truth.objects.names == frame.truth.objects.names


def test_results_stay_when_the_session_goes_on() -> None:
    session = press()
    first = next(session.frames())
    counts, force = first.scan.counts.copy(), first.image.force.copy()
    assert len(list(session.contacts())) == 999
    np.testing.assert_array_equal(first.scan.counts, counts)
    np.testing.assert_array_equal(first.image.force, force)


def test_a_session_has_one_position_like_a_file() -> None:
    session = press()
    assert next(session.images()).sequence == 0
    assert next(session.contacts()).sequence == 1
    assert session.arrays(seconds=0.1).sequence.tolist() == list(range(2, 102))
    assert next(session.scans()).sequence == 102
    assert len(session.arrays()) == 1000 - 103
    assert list(session) == []
    assert len(session.arrays()) == 0
    assert session.arrays().force.shape == (0, 5, 5)


def test_an_endless_simulation_goes_on() -> None:
    session = posfet.simulate("tap", duration=float("inf"))
    assert len(session.arrays(seconds=0.05)) == 50
    with pytest.raises(ValueError, match=r"^simulated scene 'tap' does not end: seconds must be given$"):
        session.arrays()


def test_objects_are_taken_as_well_as_names() -> None:
    sensor = load_sensor("posfet_5x5")
    scene = load_scene("press", sensor)
    given = posfet.simulate(
        scene, sensor=sensor, calibration=Calibration.nominal(sensor), imperfections="none", duration=0.1
    )
    np.testing.assert_array_equal(given.arrays().counts, press().arrays(0.1).counts)
    assert given.sensor.layout.rows == 5


def test_tare_sets_the_forces_to_zero() -> None:
    session = posfet.simulate("idle", duration=1.0, seed=2)
    session.arrays(seconds=0.5)
    tare = session.tare()
    assert tare.done, tare.message
    assert abs(next(session.images()).total) < 0.02


def test_a_closed_session_says_so() -> None:
    with press() as session:
        next(session.contacts())
    assert session.state == "closed"
    with pytest.raises(ValueError, match=r"^the session is closed$"):
        next(session.contacts())
    session.close()


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: posfet.simulate("pres"), "^pres: no such scene; did you mean press"),
        (lambda: posfet.simulate(sensor="posfet_6x6"), "^posfet_6x6: no such sensor"),
        (lambda: posfet.simulate(duration=0), r"^duration must be in \(0, inf\), got 0$"),
        (lambda: posfet.simulate(duration=float("nan")), "^duration must be .* got nan$"),
        (lambda: posfet.simulate(seed=-1), "^seed must be"),
        (lambda: posfet.simulate(imperfections="none.yaml"), "^none.yaml: cannot be read: No such file"),
        (lambda: posfet.simulate(calibration="none.yaml"), "^none.yaml: cannot be read: No such file"),
        (lambda: posfet.open("can0"), "^address must be interface:channel, such as slcan:/dev/ttyACM0"),
        (lambda: posfet.open("foo:can0"), "^CAN interface must be one of"),
        (lambda: posfet.open("emulator:pres"), "^pres: no such scene"),
        (lambda: posfet.open("slcan:none", timeout=0.0), r"^timeout must be in \(0, inf\), got 0"),
        (lambda: posfet.replay("none.mcap"), "^none.mcap: "),
        (lambda: posfet.load("none.mcap"), "^none.mcap: "),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(make: Callable[[], object], line: str) -> None:
    with pytest.raises(ValueError, match=line) as raised:
        make()
    assert "\n" not in str(raised.value)
