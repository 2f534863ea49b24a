# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Groups of tests that one worker of pytest-xdist runs; all others are distributed test by test."""

from __future__ import annotations

from typing import Final

LIVE: Final = ("model/ros/", "driver/ros/", "sim/ros/", "stack/", "driver/board/test_hardware.py")
"""Nodes and processes that run in real time: one worker runs them all, so that they do not compete for the processors.
They take longest and start first.
"""
TOGETHER: Final = (
    "layout/test_wheel.py",
    "sim/calibration/test_calibration.py",
    "sim/calibration/test_bench_recording.py",
    "sim/calibration/test_real_film.py",
    "independent/test_independent_film.py",
)
"""Files with a fixture that takes seconds to set up: one worker runs each of them."""


def scope(test: str) -> str:
    """Return the group of a test that one worker runs as a whole; the test itself if it has none."""
    file = test.split("::", maxsplit=1)[0].removeprefix("test/")
    if file.startswith(LIVE):
        return "live"
    return file if file in TOGETHER else test
