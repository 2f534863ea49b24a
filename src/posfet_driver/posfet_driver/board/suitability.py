# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Whether a board is the one that the sensor file describes."""

from __future__ import annotations

from posfet_driver.board.faults import FaultKind
from posfet_driver.protocol.messages import PROTOCOL_VERSION, Identification
from posfet_model.sensor.description import Sensor


def unsuitable(sensor: Sensor, board: Identification) -> tuple[FaultKind, str] | None:
    """Return why a board is not the one that the sensor file describes; None when it is.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    board : Identification
        What the board states.

    Returns
    -------
    tuple of FaultKind and str, or None
        The fault, and its reason in one line.
    """
    if board.protocol != PROTOCOL_VERSION:
        reason = f"the board implements version {board.protocol} of the protocol, this driver {PROTOCOL_VERSION}"
        return FaultKind.WRONG_PROTOCOL, reason
    if board.layout != sensor.layout.id:
        return FaultKind.WRONG_LAYOUT, f"the board has layout {board.layout}, the sensor file {sensor.layout.id}"
    if board.fd != sensor.can.fd:
        formats = "classic CAN", "CAN FD"
        reason = f"the board sends scans in {formats[board.fd]} frames, the sensor file says {formats[sensor.can.fd]}"
        return FaultKind.WRONG_FORMAT, reason
    return None
