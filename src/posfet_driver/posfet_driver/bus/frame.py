"""CAN frames as plain tuples, which cost a tenth of a can.Message."""

from __future__ import annotations

from typing import Final, TypeAlias

Frame: TypeAlias = tuple[int, int, bytes]
"""Identifier, kind (sum of the constants below), data; a remote frame carries as many zero bytes as it asks for."""

CLASSIC: Final = 0
"""Kind of a data frame with an 11-bit identifier and up to 8 bytes."""
EXTENDED: Final = 1
"""The identifier has 29 bits."""
REMOTE: Final = 2
"""The frame asks for data instead of carrying it."""
ERROR: Final = 4
"""The frame reports an error on the bus."""
FD: Final = 8
"""CAN FD: up to 64 bytes."""
RATE_SWITCH: Final = 16
"""CAN FD with the data phase at its own bitrate."""
