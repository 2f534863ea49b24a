# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""How late a busy machine runs the threads of this process."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Final

PERIOD: Final = 0.001
"""Time between two looks at the clock [s]."""


class Lateness:
    """Measures, in a thread of its own, how late its wake-ups are.

    A test that cannot but run in real time does not judge what the machine was too busy for.
    """

    def __init__(self) -> None:
        self.longest = 0.0
        """Longest time by which a wake-up was late [s]."""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._measure, daemon=True)

    def __enter__(self) -> Lateness:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _measure(self) -> None:
        before = time.monotonic()
        while not self._ended.wait(PERIOD):
            now = time.monotonic()
            self.longest, before = max(self.longest, now - before - PERIOD), now
