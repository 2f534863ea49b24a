# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Thread that encodes snapshots for the browser, and only while somebody looks."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Final

from posfet.web.encoding import encoded_diagnoses, encoded_frame, encoded_setup
from posfet.web.feed import Feed
from posfet.web.viewed import Viewed

FRAME_PERIOD: Final = 1 / 30
"""Period of the snapshots [s]."""
SETUP_PERIOD: Final = 0.5
"""Period at which description and diagnostics are looked at [s]; they are sent when they have changed."""
IDLE: Final = 0.5
"""Longest wait for a reader before the end is looked for [s]."""


class Sampler:
    """Puts snapshots into a feed, encoded once for all readers.

    Parameters
    ----------
    sensors : sequence of Viewed
        Sensors in the order of the page.
    scenes : sequence of str
        Names of the scenes that the page offers.
    feed : Feed
        Where the texts go.
    """

    def __init__(self, sensors: Sequence[Viewed], scenes: Sequence[str], feed: Feed) -> None:
        self._sensors, self._scenes, self._feed = sensors, scenes, feed
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="web sampler", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._feed.close()
        self._thread.join()

    def _run(self) -> None:
        next_setup = -1.0
        while not self._stop.is_set():
            if not self._feed.wait_for_reader(IDLE):
                continue
            now = time.monotonic()
            if now >= next_setup:
                next_setup = now + SETUP_PERIOD
                self._feed.put("setup", encoded_setup(self._sensors, self._scenes))
                self._feed.put("diagnostics", encoded_diagnoses(self._sensors))
            self._feed.put("frame", encoded_frame(self._sensors))
            self._stop.wait(max(now + FRAME_PERIOD - time.monotonic(), 0.0))
