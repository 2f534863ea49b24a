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
