# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""States of the connection between the driver and a board."""

from __future__ import annotations

from enum import Enum
from typing import Final

from posfet_driver.board.faults import Health


class ConnectionState(Enum):
    """What the driver is waiting for."""

    CLOSED = "closed"
    BUS = "bus"
    """The bus is not open."""
    IDENTITY = "identity"
    """IDENTIFY was sent."""
    REFUSED = "refused"
    """The board is not the one that the sensor file describes."""
    RATE = "rate"
    """SET_RATE was sent."""
    START = "start"
    """START was sent."""
    SCANS = "scans"
    STOPPED = "stopped"
    """Stopped on request."""


NOT_RECEIVING: Final = {
    ConnectionState.CLOSED,
    ConnectionState.BUS,
    ConnectionState.REFUSED,
    ConnectionState.STOPPED,
}
"""States after which the sequence of the next scan is unknown."""

HEALTH: Final = {
    ConnectionState.CLOSED: Health.STALE,
    ConnectionState.BUS: Health.ERROR,
    ConnectionState.IDENTITY: Health.WARN,
    ConnectionState.REFUSED: Health.ERROR,
    ConnectionState.RATE: Health.WARN,
    ConnectionState.START: Health.WARN,
    ConnectionState.SCANS: Health.OK,
    ConnectionState.STOPPED: Health.OK,
}
