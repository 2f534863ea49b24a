# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a decoder finds in the frames of a bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from posfet_core.protocol import Traffic
from posfet_driver.protocol.messages import Identity, Response, Status
from posfet_model.sensor.scan import Scan

__all__ = ["Decoded", "IdentityReceived", "ResponseReceived", "ScanReady", "StatusReceived", "Traffic"]


@dataclass(frozen=True, slots=True)
class ScanReady:
    """A scan is complete. The decoder overwrites it with the next one: copy what is to be kept."""

    scan: Scan


@dataclass(frozen=True, slots=True)
class StatusReceived:
    """The board sent its status."""

    status: Status


@dataclass(frozen=True, slots=True)
class ResponseReceived:
    """The board responded to a command."""

    response: Response


@dataclass(frozen=True, slots=True)
class IdentityReceived:
    """The board stated what it is."""

    identity: Identity


Decoded: TypeAlias = ScanReady | StatusReceived | IdentityReceived | ResponseReceived
