"""Which tests one worker of pytest-xdist runs: all others are shared test by test."""

from __future__ import annotations

from typing import Final

LIVE: Final = ("model/ros/", "driver/ros/", "sim/ros/", "stack/", "driver/board/test_hardware.py")
"""Nodes and processes that have to keep up with a clock: one worker runs them all, so that they do not take the
processors from each other. They take longest and come first.
"""
TOGETHER: Final = (
    "sim/calibration/test_calibration.py",
    "sim/calibration/test_bench_recording.py",
    "sim/commands/test_score.py",
)
"""Files with a fixture that takes seconds to make: one worker runs each of them."""


def scope(test: str) -> str:
    """Return the name of what one worker has to run as a whole: the test itself where it is on its own."""
    file = test.split("::", maxsplit=1)[0].removeprefix("test/")
    if file.startswith(LIVE):
        return "live"
    return file if file in TOGETHER else test
