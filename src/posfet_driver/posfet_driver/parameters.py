# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parameters of the driver node, and those that it shares with the simulated board; without ROS."""

from __future__ import annotations

from typing import Final

from posfet_model.parameters import AUTOSTART, FRAME_ID, RELIABILITY, SENSOR, Parameter

LOG_FAULTS: Final = Parameter(
    "log_faults", True, "Log faults when they appear and clear; false: in diagnostics only", read_only=False
)
SCAN_SOURCE_NODE: Final = (*SENSOR, FRAME_ID, AUTOSTART, RELIABILITY, LOG_FAULTS)
"""Parameters of every node that publishes scans."""

CAN_INTERFACE: Final = Parameter(
    "can_interface",
    "socketcan",
    "Interface of python-can: socketcan, slcan, pcan, kvaser, ...; slcan is the buffered reader of this package",
)
CAN_CHANNEL: Final = Parameter(
    "can_channel",
    "can0",
    "Channel of the interface: can0, /dev/ttyACM0, PCAN_USBBUS1, ...; a serial port may be a pattern: /dev/ttyACM*",
)
_SOCKETCAN: Final = (
    ". With socketcan, ip link sets the bus; this value only serves to compute bus load and stamp errors"
)
CAN_BITRATE: Final = Parameter(
    "can_bitrate",
    0,
    f"Nominal bitrate; 0: as in the sensor file{_SOCKETCAN}",
    unit="bit/s",
    low=0,
    high=1_000_000,
)
CAN_DATA_BITRATE: Final = Parameter(
    "can_data_bitrate",
    0,
    f"Bitrate of the data phase of CAN FD; 0: as in the sensor file{_SOCKETCAN}",
    unit="bit/s",
    low=0,
    high=8_000_000,
)
CAN_OPTIONS: Final = Parameter("can_options", [""], "Further options of the interface, each as key=value")

DRIVER_NODE: Final = (
    *SCAN_SOURCE_NODE,
    CAN_INTERFACE,
    CAN_CHANNEL,
    CAN_BITRATE,
    CAN_DATA_BITRATE,
    CAN_OPTIONS,
)
