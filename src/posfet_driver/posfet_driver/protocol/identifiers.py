# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""CAN identifiers of one board, for the filter of the bus; see docs/protocol.md."""

from __future__ import annotations

from posfet_driver.bus.frame import BoardFrames
from posfet_driver.protocol.messages import CLASSIC_BLOCK_OFFSET, COMMAND_OFFSET, RESPONSE_OFFSET
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import Sensor


def board_frames(sensor: Sensor) -> BoardFrames | None:
    """Return the identifiers of a board's frames, reserved ones included.

    Parameters
    ----------
    sensor : Sensor
        Layout, frame format and base identifier.

    Returns
    -------
    BoardFrames or None
        The identifiers; None for a board with frames of its own, of which all are read.

    Raises
    ------
    ConfigError
        When the layout does not fit the frames.
    """
    if sensor.mapping:
        return None
    codec = make_codec(sensor)
    base, last = sensor.can.base_id, max(codec.offset(codec.blocks - 1), CLASSIC_BLOCK_OFFSET - 1)
    return BoardFrames(sent=base + COMMAND_OFFSET, received=range(base + RESPONSE_OFFSET, base + last + 1))
