# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Messages on `raw` that no driver sends: none ends the model."""

from __future__ import annotations

import pytest

pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from array import array
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.contacts_message import ContactsMessage, contacts_writer
from posfet_model.ros.map_messages import ForceImageMessage, ImageMessage, PointsMessage, VibrationMessage
from posfet_model.ros.markers_message import MarkersMessage
from posfet_model.ros.scan_reader import ScanReader
from posfet_model.ros.wrench_messages import WrenchMessage
from posfet_model.sensor.description import load_sensor
from posfet_msgs.msg import TactileRaw
from support.fuzzing import COUNTS, examples

pytestmark = pytest.mark.ros
SENSOR = load_sensor()
TAXELS = SENSOR.layout.taxels

OF_CONTACTS = ContactsMessage(SENSOR, "f"), contacts_writer(SENSOR, "f"), MarkersMessage(SENSOR.layout, "f")
OF_IMAGES = [kind(SENSOR.layout, "f") for kind in (ImageMessage, WrenchMessage, ForceImageMessage, PointsMessage)]
VIBRATION = VibrationMessage(SENSOR.layout, "f")

SCANS = st.fixed_dictionaries({
    "sequence": st.one_of(st.integers(0, 20), st.integers(0, 2**64 - 1)),
    "device_time": st.one_of(st.integers(0, 20_000), st.integers(0, 2**64 - 1)),
    "frames_lost": st.integers(0, 2**32 - 1),
    "status": st.integers(0, 255),
    "layout_id": st.sampled_from([SENSOR.layout.id, SENSOR.layout.id, SENSOR.layout.id, 7]),
    "rows": st.sampled_from([5, 5, 5, 0]),
    "cols": st.sampled_from([5, 5, 5, 65535]),
    "counts": st.one_of(
        st.lists(st.integers(0, 65535), min_size=TAXELS, max_size=TAXELS), st.lists(st.integers(0, 65535), max_size=30)
    ),
    "stamp_uncertainty": st.floats(width=32),
    "temperatures": st.one_of(
        st.lists(st.floats(width=32), min_size=2, max_size=2), st.lists(st.floats(width=32), max_size=3)
    ),
    "sec": st.one_of(st.integers(0, 3), st.integers(-(2**31), 2**31 - 1)),
    "nanosec": st.integers(0, 2**32 - 1),
})  # fmt: skip


def message(sec: int, nanosec: int, counts: list[int], temperatures: list[float], **fields: Any) -> TactileRaw:
    made = TactileRaw(counts=array("H", counts), temperatures=temperatures, **fields)
    made.header.stamp.sec, made.header.stamp.nanosec = sec, nanosec
    return made


@pytest.mark.parametrize("count", COUNTS)
def test_any_scans_are_processed(count: int) -> None:
    @examples(count // 2)
    @given(st.lists(SCANS, min_size=1, max_size=15))
    def check(scans: list[dict[str, Any]]) -> None:
        reader, reconstructor = ScanReader(SENSOR.layout), Reconstructor(SENSOR)
        reconstructor.vibration_wanted = True
        for fields in scans:
            result = reconstructor.process(reader.read(message(**fields)))
            image = reconstructor.image()
            assert image.force.shape == (TAXELS,)
            for output in OF_CONTACTS:
                output.fill(result)
            for output in OF_IMAGES:
                output.fill(result, image)
            VIBRATION.fill(result, reconstructor.vibration())
            reconstructor.run_maintenance()
        reconstructor.tare(True)

    check()


def test_a_stamp_out_of_range_does_not_end_the_model() -> None:
    fields = {"layout_id": SENSOR.layout.id, "rows": 5, "cols": 5, "sequence": 0, "device_time": 0}
    scan = message(2**31 - 1, 2**32 - 1, [30_000] * TAXELS, [25.0, 25.0], **fields)
    reader, reconstructor = ScanReader(SENSOR.layout), Reconstructor(SENSOR)
    result = reconstructor.process(reader.read(scan))
    for output in OF_CONTACTS:
        assert output.fill(result) is not None
    assert OF_CONTACTS[0].fill(result).header.stamp.sec == 2**31 - 1
