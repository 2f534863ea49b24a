# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled serialisation of contacts equals that of the middleware, for any contacts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")
from rclpy.serialization import deserialize_message, serialize_message

from posfet_core.contact import Contact, ContactState, Merged, Motion, Region
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.contacts_message import ContactsMessage
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain
from posfet_msgs.msg import TactileContacts

pytestmark = pytest.mark.ros
SENSOR = load_sensor()
IDS = st.integers(1, 2**32 - 1)
PLACES = st.tuples(*[st.floats(-1e-2, 1e-2)] * 2)
FORCES = st.floats(0.0, 20.0) | st.just(math.nan)
TAXELS = st.lists(st.integers(0, 24), max_size=9).map(lambda taxels: np.array(taxels, np.intp))
REGIONS = st.builds(
    Region, TAXELS, TAXELS, PLACES, PLACES, FORCES, FORCES, FORCES, FORCES, PLACES, PLACES, st.booleans()
)
MERGED = st.lists(st.builds(Merged, IDS, st.floats(-10, 10), PLACES, IDS), max_size=4).map(tuple)
CONTACTS = st.builds(
    Contact,
    IDS,
    st.sampled_from(ContactState),
    REGIONS,
    PLACES | st.just((math.nan, math.nan)),
    st.floats(0.0, 1e5),
    MERGED,
    st.integers(0, 2**32 - 1),
)
MOTIONS = st.builds(Motion, st.floats(0.0, 1.0), st.booleans(), st.floats(0.0, 1.0))
SENSORS = st.builds(
    lambda name, radius, axis: replace(
        SENSOR, name=name, layout=replace(SENSOR.layout, bend_radius=radius, bend_axis=axis)
    ),
    st.text("abc_\u00e9\u4e2d", min_size=1, max_size=9),
    st.sampled_from([math.inf, 8e-3, 12e-3]),
    st.sampled_from(["x", "y"]),
)
RESULTS = st.builds(
    Reconstruction,
    st.just(True),
    st.just(False),
    st.integers(0, 2**31 * 10**9 - 1),
    st.integers(0, 2**64 - 1),
    st.booleans(),
    st.lists(CONTACTS, max_size=4, unique_by=lambda contact: contact.id).map(tuple),
    st.just({}),
    st.just(0),
)


def assert_same(ours: bytes, theirs: bytes) -> None:
    """Padding bytes are arbitrary: compare what a subscriber reads."""
    assert len(ours) == len(theirs)
    assert str(deserialize_message(ours, TactileContacts)) == str(deserialize_message(theirs, TactileContacts))


@settings(max_examples=40)
@given(SENSORS, st.text("ab/\u00e9", max_size=9), RESULTS, st.lists(MOTIONS, max_size=3))
def test_contacts_of_any_kind_are_serialised_as_by_the_middleware(
    sensor: Sensor, frame: str, result: Reconstruction, motions: list[Motion]
) -> None:
    result.motions = {contact.id: motion for contact, motion in zip(result.contacts, motions, strict=False)}
    theirs = serialize_message(ContactsMessage(sensor, frame).fill(result))
    assert_same(ContactsBytes(sensor, frame).fill(result), theirs)


def test_the_result_of_a_scan_is_serialised_without_its_objects_and_with_them() -> None:
    """Touch, hold and release; also of scans that are refused."""
    model, writer = Reconstructor(SENSOR), ContactsBytes(SENSOR, "finger")
    chain = ForwardSignalChain(SENSOR, np.random.default_rng(3))
    force, most, released = np.zeros(SENSOR.layout.taxels), 0, False
    for index in range(700):
        force[[11, 12, 13]] = (0.2, 0.5, 0.2) if 300 <= index < 600 else (0.0, 0.0, 0.0)
        chain.advance(force, 25.0, 1e-3)
        scan = Scan(index * 1_000_000, 1, index, index * 1000, chain.counts(), np.full(2, 25.0, np.float32), 0, 0)
        scan.layout_id += index % 50 == 49
        result = model.process(scan)
        ours = writer.fill(result)
        most = max(most, len(result.contacts))
        released = released or any(contact.state is ContactState.RELEASED for contact in result.contacts)
        assert_same(ours, writer.fill(result.snapshot()))
    assert most == 1
    assert released
