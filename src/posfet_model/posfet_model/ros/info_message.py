# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The sensor description as TactileInfo."""

from __future__ import annotations

from geometry_msgs.msg import Pose

from posfet_model.ros.message_fields import set_stamp, set_vector
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton, volts_per_count
from posfet_model.sensor.surface import Surface
from posfet_msgs.msg import TactileInfo


def info_message(sensor: Sensor, frame_id: str, simulated: bool, stamp: int) -> TactileInfo:
    """Return the description of `sensor`, valid from `stamp` on [ns since the Unix epoch].

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    frame_id : str
        Frame of the array.
    simulated : bool
        Whether the signals come from a simulated board.
    stamp : int
        Time from which the description is valid [ns] since the Unix epoch.
    """
    layout = sensor.layout
    low, high = (limit / charge_per_newton(sensor) for limit in InverseSignalChain(sensor).charge_range)
    message = TactileInfo(layout_id=layout.id, name=sensor.name, serial=sensor.serial, simulated=simulated)
    message.header.frame_id = frame_id
    set_stamp(message.header.stamp, stamp)
    message.rows, message.cols = layout.rows, layout.cols
    message.pitch[:] = layout.pitch_x, layout.pitch_y
    message.taxel_area = layout.taxel_area
    message.taxel_poses = [_taxel_pose(Surface.of(layout), x, y) for x, y in layout.positions.tolist()]
    message.force_min, message.force_max = low, high
    steps_per_count = 0xFFFF / ((1 << sensor.adc.bits) - 1)
    message.force_resolution = volts_per_count(sensor) * steps_per_count / sensor.volts_per_newton
    message.contact_threshold = sensor.contact.threshold
    message.contact_deadband = sensor.contact.deadband
    message.leak_time_constant = sensor.device.leak_time_constant
    message.scan_rate = sensor.can.scan_rate
    message.adc_range[:] = sensor.adc.low, sensor.adc.high
    message.adc_bits = sensor.adc.bits
    message.force_unit, message.length_unit = "N", "m"
    return message


def _taxel_pose(surface: Surface, x: float, y: float) -> Pose:
    pose = Pose()
    set_vector(pose.position, surface.point(x, y))
    turned = pose.orientation
    turned.x, turned.y, turned.z, turned.w = surface.orientation(x, y)
    return pose
