# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

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
