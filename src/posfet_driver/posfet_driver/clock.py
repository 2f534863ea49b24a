# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Source of time, which tests replace by their own."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Source of time."""

    def monotonic(self) -> int:
        """Return monotonic time [ns], from an arbitrary origin."""
        ...

    def wall(self) -> int:
        """Return the time since the Unix epoch [ns]; jumps when it is set."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` [s]."""
        ...


class SystemClock:
    """Clock of this machine. Called several times per scan, therefore without wrappers."""

    monotonic = staticmethod(time.monotonic_ns)
    wall = staticmethod(time.time_ns)
    sleep = staticmethod(time.sleep)
