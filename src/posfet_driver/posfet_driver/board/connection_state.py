"""The phases in which a driver may be with its board."""

from __future__ import annotations

from enum import Enum
from typing import Final

from posfet_driver.board.scan_source import Health


class Phase(Enum):
    """What a board is waiting for."""

    CLOSED = "closed"
    BUS = "bus"
    IDENTITY = "identity"
    REFUSED = "refused"
    """Not the board that the sensor file describes."""
    RATE = "rate"
    START = "start"
    SCANS = "scans"
    STOPPED = "stopped"
    """On request."""


DEAF: Final = {Phase.CLOSED, Phase.BUS, Phase.REFUSED, Phase.STOPPED}
"""Phases after which the number of the next scan has to be asked again."""

HEALTH: Final = {
    Phase.CLOSED: Health.STALE,
    Phase.BUS: Health.ERROR,
    Phase.IDENTITY: Health.WARN,
    Phase.REFUSED: Health.ERROR,
    Phase.RATE: Health.WARN,
    Phase.START: Health.WARN,
    Phase.SCANS: Health.OK,
    Phase.STOPPED: Health.OK,
}
