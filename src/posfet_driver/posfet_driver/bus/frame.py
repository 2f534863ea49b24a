"""CAN frames as plain tuples, at a tenth of the cost of a can.Message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

Frame: TypeAlias = tuple[int, int, bytes]
"""Identifier, kind (sum of the constants below), data; a remote frame holds as many zero bytes as it requests."""

CLASSIC: Final = 0
"""Kind of a data frame with an 11-bit identifier and up to 8 bytes."""
EXTENDED: Final = 1
"""The identifier has 29 bits."""
REMOTE: Final = 2
"""Remote frame: requests data instead of carrying it."""
ERROR: Final = 4
"""Error frame: reports an error on the bus."""
FD: Final = 8
"""CAN FD: up to 64 bytes."""
RATE_SWITCH: Final = 16
"""CAN FD with the data phase at its own bit rate."""


@dataclass(frozen=True)
class BoardFrames:
    """Identifiers (11 bits) of the frames that are exchanged with one board."""

    sent: int
    """Identifier of the frames sent to it."""
    received: range
    """Identifiers of its own frames."""
