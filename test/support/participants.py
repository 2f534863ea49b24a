# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Participants of the middleware in this process: each has threads, sockets and shared memory of its own."""

from __future__ import annotations

import gc
from contextlib import suppress
from pathlib import Path

EVENTS = "dds.ev."
"""Begin of the name of the thread of timed events, of which Fast DDS gives each participant one."""


def participants() -> int:
    """Return how many participants this process has; 0 where threads have no names to read."""
    count = 0
    for task in Path("/proc/self/task").glob("*/comm"):
        with suppress(OSError):  # a thread that has ended since it was listed
            count += task.read_text().startswith(EVENTS)
    return count


def participants_kept() -> int:
    """Return how many participants are left once the collector has freed those that only reference cycles kept."""
    if participants():
        gc.unfreeze()  # what `spin` has put out of the collector's sight
        gc.collect()
    return participants()
